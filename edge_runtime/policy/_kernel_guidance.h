/* The guided flow of one robot: guidance/flow.py, guidance/projection.py and the costs of objectives/ in C,
 * for the same numbers. What each step means is explained there. */
#ifndef KERNEL_GUIDANCE_H
#define KERNEL_GUIDANCE_H

#include <math.h>
#include <stdbool.h>
#include <time.h>

#include "_kernel_network.h"

#define MAX_TERMS 32
#define MAX_ACTION 4
#define FEASIBLE -1e-12

/* Everything is compiled once for each d, the action's size: loops over it are unrolled. */
#define INLINE static inline __attribute__((always_inline))

/* An action or a place in the plane or in space; components beyond its size are never read. */
typedef struct {
    double at[MAX_ACTION];
} Vector;

/* Python reads names and limits from the module: nothing of this is written twice. */
typedef enum { SPEED_LIMIT, SAFETY_MARGIN, KINDS } Kind;
typedef enum { NONE, HIERARCHICAL, CONE, PROJECTIONS } Projection;

static const char *const projection_names[PROJECTIONS] = {
    [NONE] = "none", [HIERARCHICAL] = "hierarchical", [CONE] = "cone"};

/* What a kind of cost is called, and how many numbers it takes: one and a place, and then again, for each
 * neighbour, so many and a place, or nothing where this is 0. */
static const struct {
    const char *name;
    int each;
} kinds[KINDS] = {
    [SPEED_LIMIT] = {"speed_limit", 0},     /* threshold, velocity without action */
    [SAFETY_MARGIN] = {"safety_margin", 1}, /* threshold, position without action; position, side along x on
                                               which to leave a neighbour at the same place */
};

/* One objective in one tick. */
typedef struct {
    Kind kind;
    double factor;       /* eta lambda */
    int dims;            /* 2 in the plane, 3 in space */
    double gain;         /* greatest of the motion that the cost is of, per action */
    const double *gains; /* (dims, d): that motion's derivatives, in units of `gain` */
    int count;
    const double *numbers; /* (count): see `kinds` */
} Term;

typedef struct {
    Vector action;
    int steps, projections;
    int opposed; /* steps in which eq. 15 took something away */
    int fault;   /* the term whose gradient was not finite, there where `action` is; or -1 */
    double costs[MAX_TERMS];
    int conflicts[MAX_TERMS];
} Sample;

INLINE double dot(const int d, const Vector *a, const Vector *b)
{
    double sum = a->at[0] * b->at[0];
    for (int i = 1; i < d; i++)
        sum += a->at[i] * b->at[i];
    return sum;
}

INLINE Vector add_scaled(const int d, const Vector *a, double factor, const Vector *b)
{
    Vector sum;
    for (int i = 0; i < d; i++)
        sum.at[i] = a->at[i] + factor * b->at[i];
    return sum;
}

/* The predicted motion that a term's cost is of: its drift, and what the action adds. */
INLINE Vector moved(const int d, const int dims, const Term *term, const Vector *action)
{
    Vector motion;
    for (int i = 0; i < dims; i++) {
        const double *row = term->gains + i * d;
        double share = row[0] * action->at[0];
        for (int j = 1; j < d; j++)
            share += row[j] * action->at[j];
        motion.at[i] = term->numbers[1 + i] + term->gain * share;
    }
    return motion;
}

/* The costs: each also gives its slope over that motion, in units of 1 / gain, zero before the call. */

INLINE double speed_cost(const int dims, const Term *term, const Vector *velocity, Vector *slope)
{
    const double speed = sqrt(dot(dims, velocity, velocity)), excess = speed - term->numbers[0];
    if (excess <= 0.0)
        return 0.0;
    const double cure = excess / term->gain;
    *slope = add_scaled(dims, slope, cure / speed, velocity);
    return 0.5 * cure * cure;
}

INLINE double margin_cost(const int dims, const Term *term, const Vector *position, Vector *slope)
{
    const double threshold = term->numbers[0], *const end = term->numbers + term->count;
    double cost = 0.0;
    for (const double *neighbour = term->numbers + 1 + dims; neighbour < end; neighbour += dims + 1) {
        Vector apart;
        for (int i = 0; i < dims; i++)
            apart.at[i] = position->at[i] - neighbour[i];
        const double square = dot(dims, &apart, &apart);
        if (square < threshold * threshold) {
            double distance = sqrt(square);
            const double cure = (threshold - distance) / term->gain;
            cost += 0.5 * cure * cure;
            if (distance == 0.0) {
                apart.at[0] = neighbour[dims];
                distance = 1.0;
            }
            *slope = add_scaled(dims, slope, -cure / distance, &apart);
        }
    }
    return cost;
}

/* A term's cost and its gradient with respect to the action. */
INLINE double evaluate_in(const int d, const int dims, const Term *term, const Vector *action,
                          Vector *gradient)
{
    const Vector motion = moved(d, dims, term, action);
    Vector slope = {{0.0}};
    const double cost = term->kind == SPEED_LIMIT ? speed_cost(dims, term, &motion, &slope)
                                                  : margin_cost(dims, term, &motion, &slope);
    for (int j = 0; j < d; j++) {
        gradient->at[j] = term->gains[j] * slope.at[0];
        for (int i = 1; i < dims; i++)
            gradient->at[j] += term->gains[i * d + j] * slope.at[i];
    }
    return cost;
}

INLINE double evaluate_term(const int d, const Term *term, const Vector *action, Vector *gradient)
{
    return term->dims == 2 ? evaluate_in(d, 2, term, action, gradient)
                           : evaluate_in(d, 3, term, action, gradient);
}

/* Each projection returns whether it changed the sum. */

INLINE bool harmonize(const int d, const Vector *gradients, const double *factors, int count, Vector *sum)
{
    bool changed = false;
    Vector total = {{0.0}};
    for (int m = 0; m < count; m++) {
        Vector kept = gradients[m];
        for (int n = 0; n < count; n++) {
            const double opposing = dot(d, &kept, &gradients[n]),
                         square = dot(d, &gradients[n], &gradients[n]);
            if (n != m && opposing < 0.0 && square > 0.0) {
                kept = add_scaled(d, &kept, -opposing / square, &gradients[n]);
                changed = true;
            }
        }
        total = add_scaled(d, &total, factors[m], &kept);
    }
    *sum = total;
    return changed;
}

INLINE bool project_onto_nominal(const int d, const Vector *nominal, Vector *guidance)
{
    const double opposing = dot(d, guidance, nominal), square = dot(d, nominal, nominal);
    if (opposing >= 0.0 || square == 0.0)
        return false;
    *guidance = add_scaled(d, guidance, -opposing / square, nominal);
    return true;
}

INLINE bool descends(const int d, const Vector *vector, const Vector *gradients, int count)
{
    const double length = sqrt(dot(d, vector, vector));
    for (int m = 0; m < count; m++)
        if (dot(d, vector, &gradients[m]) <
            FEASIBLE * length * sqrt(dot(d, &gradients[m], &gradients[m])))
            return false;
    return true;
}

/* The longest point of the cone among the projections of `from` onto what is orthogonal to up to d - 1 of the
 * gradients from `first` on, and to those before: all these places pass the origin, so that the longest is the
 * nearest. Projecting further only shortens, and a gradient that is not opposed does not hold the nearest. */
typedef struct {
    const Vector *gradients;
    int count;
    Vector directions[MAX_ACTION]; /* orthogonal, of the gradients taken so far */
    Vector best;
    double longest;
} Search;

static void search_cone(const int d, Search *search, int first, int taken, const Vector *from)
{
    for (int m = first; m < search->count; m++) {
        Vector direction = search->gradients[m];
        const double whole = dot(d, &direction, &direction);
        for (int t = 0; t < taken; t++) {
            const Vector *other = &search->directions[t];
            const double share = dot(d, &direction, other) / dot(d, other, other);
            direction = add_scaled(d, &direction, -share, other);
        }
        const double along = dot(d, from, &direction), square = dot(d, &direction, &direction);
        if (!(square > 1e-24 * whole))
            continue; /* nothing, or a combination of those taken */
        const Vector point = add_scaled(d, from, -along / square, &direction);
        const double length = dot(d, &point, &point);
        if (!(length > search->longest))
            continue;
        if (along < 0.0 && descends(d, &point, search->gradients, search->count)) {
            search->best = point;
            search->longest = length;
        } else if (taken + 2 < d) {
            search->directions[taken] = direction;
            search_cone(d, search, m + 1, taken + 1, &point);
        }
    }
}

INLINE bool project_onto_cone(const int d, const Vector *gradients, int count, Vector *guidance)
{
    if (descends(d, guidance, gradients, count))
        return false;
    Search search = {.gradients = gradients, .count = count};
    if (d > 1)
        search_cone(d, &search, 0, 0, guidance);
    *guidance = search.best;
    return true;
}

INLINE bool combine(const int d, Projection projection, const Vector *gradients, const double *factors,
                    int count, const Vector *nominal, Vector *guidance, bool *opposed)
{
    *opposed = false;
    *guidance = (Vector){{0.0}};
    for (int m = 0; m < count; m++)
        *guidance = add_scaled(d, guidance, factors[m], &gradients[m]);
    bool changed = false;
    switch (projection) {
    case NONE: break;
    case HIERARCHICAL:
        changed = harmonize(d, gradients, factors, count, guidance);
        *opposed = project_onto_nominal(d, nominal, guidance);
        changed |= *opposed;
        break;
    case CONE: changed = project_onto_cone(d, gradients, count, guidance); break;
    case PROJECTIONS: break;
    }
    return changed;
}

/* Counts every pair of gradients that oppose each other, for both terms. */
INLINE void count_conflicts(const int d, const Vector *gradients, const int *term, int count, int *conflicts)
{
    for (int m = 1; m < count; m++)
        for (int n = 0; n < m; n++)
            if (dot(d, &gradients[m], &gradients[n]) < 0.0) {
                conflicts[term[m]]++;
                conflicts[term[n]]++;
            }
}

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* T Euler steps, or as many as fit in the time left; guidance/flow.py for batch 1. */
INLINE Sample sample_sized(const int d, Network *net, Projection projection, const Term *terms, int count,
                           Vector action, double left_s, int most_steps)
{
    Sample sample = {.fault = -1};
    const double begin = seconds();
    double now = begin, longest = 0.0;
    for (int k = 0; k < net->euler_steps; k++) {
        float result[(1 + MAX_ACTION) * MAX_ACTION], at[MAX_ACTION];
        for (int i = 0; i < d; i++)
            at[i] = (float)action.at[i];
        net->engine->step(net, k, count > 0 ? d : 0, at, result);
        Vector velocity, tangents[MAX_ACTION]; /* v and dv/da_j */
        for (int i = 0; i < d; i++) {
            velocity.at[i] = result[i];
            for (int j = 0; j < d; j++)
                tangents[j].at[i] = result[(1 + j) * d + i];
        }
        const double left = 1.0 - (double)k / net->euler_steps;
        const Vector estimate = add_scaled(d, &action, left, &velocity);
        Vector gradients[MAX_TERMS], guidance;
        double factors[MAX_TERMS];
        int term[MAX_TERMS], steering = 0;
        bool opposed;
        for (int m = 0; m < count; m++) {
            Vector gradient;
            sample.costs[m] = evaluate_term(d, &terms[m], &estimate, &gradient);
            bool finite = true, steers = false;
            for (int j = 0; j < d; j++) {
                finite = finite && isfinite(gradient.at[j]);
                steers = steers || gradient.at[j] != 0.0;
            }
            if (!finite) {
                sample.action = estimate;
                sample.fault = m;
                sample.steps = k;
                return sample;
            }
            if (steers) {
                for (int j = 0; j < d; j++)
                    gradients[steering].at[j] = -gradient.at[j] - left * dot(d, &tangents[j], &gradient);
                factors[steering] = terms[m].factor;
                term[steering++] = m;
            }
        }
        sample.projections +=
            combine(d, projection, gradients, factors, steering, &velocity, &guidance, &opposed);
        sample.opposed += opposed;
        count_conflicts(d, gradients, term, steering, sample.conflicts);
        const Vector step = add_scaled(d, &velocity, 1.0, &guidance);
        sample.action = action = add_scaled(d, &action, 1.0 / net->euler_steps, &step);
        sample.steps = k + 1;
        const double before = now;
        now = seconds();
        longest = fmax(longest, now - before);
        if (k + 1 < net->euler_steps && (now - begin + longest > left_s || k + 1 == most_steps)) {
            sample.action = add_scaled(d, &estimate, 1.0 / net->euler_steps, &guidance);
            break;
        }
    }
    return sample;
}

static Sample sample_guided(Network *net, Projection projection, const Term *terms, int count, Vector action,
                            double left_s, int most_steps)
{
    switch (net->action_dim) {
    case 1: return sample_sized(1, net, projection, terms, count, action, left_s, most_steps);
    case 2: return sample_sized(2, net, projection, terms, count, action, left_s, most_steps);
    case 3: return sample_sized(3, net, projection, terms, count, action, left_s, most_steps);
    default: return sample_sized(MAX_ACTION, net, projection, terms, count, action, left_s, most_steps);
    }
}

#undef INLINE
#endif
