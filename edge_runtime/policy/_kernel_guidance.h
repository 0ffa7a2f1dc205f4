/* The guided flow of robots: guidance/flow.py and correction.py in C, for the same numbers. What each step means
 * is explained there. */
#ifndef KERNEL_GUIDANCE_H
#define KERNEL_GUIDANCE_H

#include <time.h>

#include "_kernel_network.h"
#include "_kernel_projection.h"

/* Of guidance/correction.py, where each is explained. */
#define TINY 1e-300
#define KEPT 1e-18
#define LESS (1.0 - 1e-9)
#define SHARPEST 0.01

/* One robot's action on its way along the flow, and what happened to it. */
typedef struct {
    Vector action, correction;
    double reach;               /* how far preferences move it at most */
    Vector estimate, guidance, network; /* of the newest step; the network is N of flow_steps.py */
    int steps, projections;
    int opposed; /* steps in which eq. 15 took something away */
    int fault;   /* the objective whose cost or gradient was not finite, there where `action` is; or -1 */
    bool cut;    /* before the last step */
    double costs[MAX_TERMS];
    int conflicts[MAX_TERMS];
} Sample;

/* Robots on their way, each with its terms. */
typedef struct {
    const Steering *steering;
    int robots;
    Term *terms;     /* (robots, M) */
    Sample *samples; /* (robots): action is the start */
    float *actions;  /* (robots, d): what the network reads, */
    float *result;   /* (robots, 1 + d, d) and writes; without tangents (robots, 1, d) */
    PyObject *own;   /* called for terms of kind PYTHON: (place, action) -> (cost, gradient), or None */
} Flight;

static PyObject *tuple_of(const double *numbers, int count)
{
    PyObject *tuple = PyTuple_New(count);
    for (int i = 0; tuple != NULL && i < count; i++)
        PyTuple_SET_ITEM(tuple, i, PyFloat_FromDouble(numbers[i]));
    return tuple;
}

/* Asks Python for a cost and its gradient; NaN where it has none, or raised. */
static double ask_python(PyObject *own, int place, int d, const Vector *action, Vector *gradient)
{
    PyObject *at = tuple_of(action->at, d), *answer = NULL;
    double cost = NAN;
    if (at != NULL)
        answer = PyObject_CallFunction(own, "iO", place, at);
    PyObject *slopes;
    if (answer != NULL && answer != Py_None && PyArg_ParseTuple(answer, "dO!", &cost, &PyTuple_Type, &slopes)) {
        if (PyTuple_GET_SIZE(slopes) != d)
            PyErr_Format(PyExc_ValueError, "a gradient of %d numbers was expected", d);
        for (int j = 0; !PyErr_Occurred() && j < d; j++)
            gradient->at[j] = PyFloat_AsDouble(PyTuple_GET_ITEM(slopes, j));
    }
    Py_XDECREF(at);
    Py_XDECREF(answer);
    return PyErr_Occurred() ? NAN : cost;
}

/* A term's cost at an action, which the sample keeps, and its gradient; false where they are not finite. */
INLINE bool evaluate(const int d, const Flight *flight, const Term *term, int m, const Vector *action,
                     Sample *sample, Vector *gradient)
{
    const double cost = term->cost == OWN ? ask_python(flight->own, m, d, action, gradient)
                                          : evaluate_term(d, term, action, gradient);
    sample->costs[m] = cost;
    if (isfinite(cost) && isfinite(cost + sum_of(d, gradient)))
        return true;
    sample->fault = m;
    return false;
}

/* The action at a step's end; flow_steps.py says how. */
INLINE void move(const int d, const FlowStep *step, const Vector *velocity, Sample *sample)
{
    const Vector network = add_scaled(d, velocity, -step->prior, &sample->action);
    Vector kept;
    for (int i = 0; i < d; i++)
        kept.at[i] = step->keep * sample->action.at[i];
    const Vector change = add_scaled(d, &network, -1.0, &sample->network);
    const Vector ahead = add_scaled(d, &network, step->ahead, &change);
    const Vector held = add_scaled(d, &ahead, 1.0, &sample->guidance);
    sample->action = add_scaled(d, &kept, step->gain, &held);
    sample->network = network;
}

/* One robot's step from what the network gave; false at a fault. */
INLINE bool steer(const int d, const Flight *flight, const Term *terms, const FlowStep *step,
                  const float *result, Sample *sample)
{
    Vector velocity, tangents[MAX_ACTION]; /* v and dv/da_j, for what steers */
    for (int i = 0; i < d; i++) {
        velocity.at[i] = result[i];
        for (int j = 0; flight->steering->steers && j < d; j++)
            tangents[j].at[i] = result[(1 + j) * d + i];
    }
    const double left = 1.0 - step->tau;
    sample->estimate = add_scaled(d, &sample->action, left, &velocity);
    Vector gradients[MAX_TERMS];
    double factors[MAX_TERMS];
    int term[MAX_TERMS], steering = 0;
    for (int m = 0; flight->steering->steers && m < flight->steering->count; m++) {
        Vector gradient;
        if (!evaluate(d, flight, &terms[m], m, &sample->estimate, sample, &gradient)) {
            sample->action = sample->estimate;
            return false;
        }
        bool steers = false;
        for (int j = 0; j < d; j++)
            steers = steers || gradient.at[j] != 0.0;
        if (steers) {
            for (int j = 0; j < d; j++)
                gradients[steering].at[j] = -gradient.at[j] - left * dot(d, &tangents[j], &gradient);
            factors[steering] = terms[m].factor;
            term[steering++] = m;
        }
    }
    bool opposed;
    sample->projections += combine(d, flight->steering->projection, gradients, factors, steering, &velocity,
                                   &sample->guidance, &opposed);
    sample->opposed += opposed;
    count_conflicts(d, gradients, term, steering, sample->conflicts);
    move(d, step, &velocity, sample);
    sample->steps++;
    return true;
}

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* T steps of all robots, or as many as fit in the time left. */
INLINE void flow(const int d, Network *net, const Flight *flight, double left_s, int most_steps)
{
    const int total = net->steps, count = flight->steering->count;
    const int tangents = flight->steering->steers ? d : 0;
    const double begin = seconds();
    double now = begin, longest = 0.0;
    bool going = true, late = false;
    for (int k = 0; k < total && going && !late; k++) {
        for (int b = 0; b < flight->robots; b++)
            for (int i = 0; i < d; i++)
                flight->actions[b * d + i] = (float)flight->samples[b].action.at[i];
        net->engine->step(net, k, tangents, flight->actions, flight->result);
        going = false;
        for (int b = 0; b < flight->robots; b++) {
            Sample *sample = &flight->samples[b];
            const float *result = flight->result + (size_t)b * (1 + tangents) * d;
            if (sample->fault < 0)
                going |= steer(d, flight, flight->terms + (size_t)b * count, &net->schedule[k], result, sample);
        }
        const double before = now;
        now = seconds();
        longest = fmax(longest, now - before);
        late = k + 1 < total && (now - begin + longest > left_s || k + 1 == most_steps);
    }
    for (int b = 0; late && b < flight->robots; b++) {
        Sample *sample = &flight->samples[b];
        if (sample->fault < 0) {
            const double gain = net->schedule[sample->steps - 1].gain;
            sample->action = add_scaled(d, &sample->estimate, gain, &sample->guidance);
            sample->cut = true;
        }
    }
}

/* Costs and descent directions of preferences, or of requirements, and their places; their number, or -1 at a
 * fault. */
INLINE int descents(const int d, const Flight *flight, const Term *terms, bool preference,
                    const Vector *action, Sample *sample, Vector *directions, int *places)
{
    int found = 0;
    for (int m = 0; m < flight->steering->count; m++) {
        Vector gradient;
        if (terms[m].preference != preference)
            continue;
        if (!evaluate(d, flight, &terms[m], m, action, sample, &gradient))
            return -1;
        places[found] = m;
        directions[found++] = negative(d, &gradient);
    }
    return found;
}

/* Moves an action as preferences wish; false at a fault. */
INLINE bool prefer(const int d, const Flight *flight, const Term *terms, Sample *sample, Vector *action)
{
    const Steering *steering = flight->steering;
    const Vector finished = *action;
    Vector directions[MAX_TERMS], move;
    double weights[MAX_TERMS];
    int places[MAX_TERMS], count = 1;
    bool opposed;
    for (int round = 0; round < steering->rounds && count > 0; round++) {
        count = descents(d, flight, terms, true, action, sample, directions, places);
        for (int n = 0; n < count; n++)
            weights[n] = terms[places[n]].weight;
        if (count > 0) {
            combine(d, NONE, directions, weights, count, NULL, &move, &opposed);
            move = add_scaled(d, action, steering->rate, &move);
            move = add_scaled(d, &move, -1.0, &finished);
            const double kept = fmin(1.0, sample->reach / fmax(length_of(d, &move), TINY));
            *action = add_scaled(d, &finished, kept, &move);
        }
    }
    return count >= 0;
}

/* A Newton step: along the boundary that the last one led to if it opposes that, as far as keeps both. */
INLINE Vector newton_step(const int d, Vector direction, const Vector *last)
{
    const double opposing = dot(d, &direction, last), last_square = dot(d, last, last);
    if (!(opposing < 0.0 && last_square > 0.0))
        return direction;
    const Vector along = add_scaled(d, &direction, -opposing / last_square, last);
    const double square = dot(d, &direction, &direction), free = dot(d, &along, &along);
    const Vector nothing = {{0.0}};
    return free > SHARPEST * square ? add_scaled(d, &nothing, square / free, &along) : direction;
}

/* Moves an action as is required; false at a fault. The sample keeps the costs from before. */
INLINE bool require(const int d, const Flight *flight, const Term *terms, Sample *sample, Vector *action)
{
    Vector directions[MAX_TERMS], step, last = {{0.0}};
    double ones[MAX_TERMS], first[MAX_TERMS], least = INFINITY;
    int places[MAX_TERMS];
    bool violated = false, opposed;
    const int count = descents(d, flight, terms, false, action, sample, directions, places);
    if (count <= 0)
        return count == 0;
    for (int n = 0; n < count; n++) {
        ones[n] = 1.0;
        violated = violated || sample->costs[places[n]] != 0.0;
    }
    const int rounds = violated && flight->steering->steps > 1 ? flight->steering->steps : 0;
    memcpy(first, sample->costs, sizeof first);
    combine(d, CONE, directions, ones, count, NULL, &step, &opposed);
    Vector at = *action = add_scaled(d, action, 1.0, &step);
    for (int round = 0, place = -1; round < rounds; round++) {
        if (descents(d, flight, terms, false, &at, sample, directions, places) < 0)
            return false;
        double total = 0.0, most = 0.0;
        int worst = -1;
        for (int n = 0; n < count; n++) {
            const double cost = sample->costs[places[n]];
            total += cost;
            if (cost > KEPT && (worst < 0 || worst == place || (n != place && cost > most))) {
                worst = n;
                most = cost;
            }
        }
        if (total < LESS * least) {
            least = total;
            *action = at;
        }
        if (worst < 0)
            break;
        step = newton_step(d, directions[worst], &last);
        at = add_scaled(d, &at, 1.0, &step);
        last = directions[worst];
        place = worst;
    }
    memcpy(sample->costs, first, sizeof first);
    return true;
}

/* Moves a finished action at tau = 1: guidance/correction.py. */
INLINE void correct(const int d, const Flight *flight, const Term *terms, Sample *sample)
{
    Vector action = sample->action;
    if (!prefer(d, flight, terms, sample, &action) || !require(d, flight, terms, sample, &action))
        return;
    sample->correction = add_scaled(d, &action, -1.0, &sample->action);
    sample->action = action;
}

INLINE void sample_sized(const int d, Network *net, const Flight *flight, double left_s, int most_steps)
{
    const Steering *steering = flight->steering;
    flow(d, net, flight, left_s, most_steps);
    for (int b = 0; steering->rounds >= 0 && b < flight->robots; b++) {
        Sample *sample = &flight->samples[b];
        Term *terms = flight->terms + (size_t)b * steering->count;
        for (int m = 0; m < steering->count; m++)
            terms[m] = in_si_units(terms[m], &steering->objectives[m]);
        if (sample->fault < 0 && isfinite(sum_of(d, &sample->action)))
            correct(d, flight, terms, sample);
    }
}

/* Samples the guided actions of robots of d action components. */
static void sample_guided(Network *net, const Flight *flight, double left_s, int most_steps)
{
    switch (net->action_dim) {
    case 1: sample_sized(1, net, flight, left_s, most_steps); break;
    case 2: sample_sized(2, net, flight, left_s, most_steps); break;
    case 3: sample_sized(3, net, flight, left_s, most_steps); break;
    default: sample_sized(MAX_ACTION, net, flight, left_s, most_steps);
    }
}

#undef INLINE
#endif
