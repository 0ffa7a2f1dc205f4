/* The guided flow of one planar robot: guidance/flow.py, guidance/projection.py and the costs of
 * objectives/ in C, for the same numbers. What each step means is explained there. */
#ifndef KERNEL_GUIDANCE_H
#define KERNEL_GUIDANCE_H

#include <math.h>
#include <stdbool.h>
#include <time.h>

#include "_kernel_network.h"

#define MAX_TERMS 32
#define FEASIBLE -1e-12

typedef struct {
    double x, y;
} Vector2;

/* Python reads names and limits from the module: nothing of this is written twice. */
typedef enum { SPEED_LIMIT, SAFETY_MARGIN, KINDS } Kind;
typedef enum { NONE, HIERARCHICAL, CONE, PROJECTIONS } Projection;

static const char *const projection_names[PROJECTIONS] = {
    [NONE] = "none", [HIERARCHICAL] = "hierarchical", [CONE] = "cone"};

/* What a kind of cost is called, and how many numbers it takes: some, and then again so many a neighbour. */
static const struct {
    const char *name;
    int first, each;
} kinds[KINDS] = {
    [SPEED_LIMIT] = {"speed_limit", 3, 0},     /* threshold, velocity without action */
    [SAFETY_MARGIN] = {"safety_margin", 3, 3}, /* threshold, position without action; position, side along x
                                                  on which to leave a neighbour at the same place */
};

/* One objective in one tick. */
typedef struct {
    Kind kind;
    double factor;      /* eta lambda */
    double shift, push; /* d position / d action, d velocity / d action of its preview */
    int count;
    const double *numbers; /* (count): see `kinds` */
} Term;

typedef struct {
    Vector2 action;
    int steps, projections;
    int opposed; /* steps in which eq. 15 took something away */
    int fault;   /* the term whose gradient was not finite, there where `action` is; or -1 */
    double costs[MAX_TERMS];
    int conflicts[MAX_TERMS];
} Sample;

static double dot2(Vector2 a, Vector2 b) { return a.x * b.x + a.y * b.y; }
static Vector2 add_scaled(Vector2 a, double factor, Vector2 b)
{
    return (Vector2){a.x + factor * b.x, a.y + factor * b.y};
}

/* The costs: each also gives its gradient with respect to the action, zero before the call. */

static double speed_cost(const Term *term, Vector2 action, Vector2 *gradient)
{
    const double threshold = term->numbers[0];
    const Vector2 drift = {term->numbers[1], term->numbers[2]};
    const Vector2 velocity = add_scaled(drift, term->push, action);
    const double speed = sqrt(dot2(velocity, velocity)), excess = speed - threshold;
    if (excess <= 0.0)
        return 0.0;
    const double cure = excess / term->push;
    *gradient = add_scaled(*gradient, cure / speed, velocity);
    return 0.5 * cure * cure;
}

static double margin_cost(const Term *term, Vector2 action, Vector2 *gradient)
{
    const double threshold = term->numbers[0];
    const Vector2 drift = {term->numbers[1], term->numbers[2]};
    const Vector2 position = add_scaled(drift, term->shift, action);
    double cost = 0.0;
    for (const double *neighbour = term->numbers + 3; neighbour < term->numbers + term->count;
         neighbour += 3) {
        Vector2 apart = {position.x - neighbour[0], position.y - neighbour[1]};
        const double square = dot2(apart, apart);
        if (square < threshold * threshold) {
            double distance = sqrt(square);
            const double cure = (threshold - distance) / term->shift;
            cost += 0.5 * cure * cure;
            if (distance == 0.0) {
                apart.x = neighbour[2];
                distance = 1.0;
            }
            *gradient = add_scaled(*gradient, -cure / distance, apart);
        }
    }
    return cost;
}

static double evaluate_term(const Term *term, Vector2 action, Vector2 *gradient)
{
    *gradient = (Vector2){0.0, 0.0};
    switch (term->kind) {
    case SPEED_LIMIT: return speed_cost(term, action, gradient);
    case SAFETY_MARGIN: return margin_cost(term, action, gradient);
    case KINDS: break;
    }
    return 0.0;
}

/* Each projection returns whether it changed the sum. */

static bool harmonize(const Vector2 *gradients, const double *factors, int count, Vector2 *sum)
{
    bool changed = false;
    Vector2 total = {0.0, 0.0};
    for (int m = 0; m < count; m++) {
        Vector2 kept = gradients[m];
        for (int n = 0; n < count; n++) {
            const double dot = dot2(kept, gradients[n]), square = dot2(gradients[n], gradients[n]);
            if (n != m && dot < 0.0 && square > 0.0) {
                kept = add_scaled(kept, -dot / square, gradients[n]);
                changed = true;
            }
        }
        total = add_scaled(total, factors[m], kept);
    }
    *sum = total;
    return changed;
}

static bool project_onto_nominal(Vector2 nominal, Vector2 *guidance)
{
    const double dot = dot2(*guidance, nominal), square = dot2(nominal, nominal);
    if (dot >= 0.0 || square == 0.0)
        return false;
    *guidance = add_scaled(*guidance, -dot / square, nominal);
    return true;
}

static bool descends(Vector2 vector, const Vector2 *gradients, int count)
{
    const double length = sqrt(dot2(vector, vector));
    for (int m = 0; m < count; m++)
        if (dot2(vector, gradients[m]) < FEASIBLE * length * sqrt(dot2(gradients[m], gradients[m])))
            return false;
    return true;
}

static bool project_onto_cone(const Vector2 *gradients, int count, Vector2 *guidance)
{
    if (descends(*guidance, gradients, count))
        return false;
    Vector2 best = {0.0, 0.0};
    double longest = 0.0;
    for (int m = 0; m < count; m++) {
        const double dot = dot2(*guidance, gradients[m]), square = dot2(gradients[m], gradients[m]);
        if (dot < 0.0 && square > 0.0) {
            const Vector2 point = add_scaled(*guidance, -dot / square, gradients[m]);
            const double length = dot2(point, point);
            if (length > longest && descends(point, gradients, count)) {
                best = point;
                longest = length;
            }
        }
    }
    *guidance = best;
    return true;
}

static bool combine(Projection projection, const Vector2 *gradients, const double *factors, int count,
                    Vector2 nominal, Vector2 *guidance, bool *opposed)
{
    *opposed = false;
    *guidance = (Vector2){0.0, 0.0};
    for (int m = 0; m < count; m++)
        *guidance = add_scaled(*guidance, factors[m], gradients[m]);
    bool changed = false;
    switch (projection) {
    case NONE: break;
    case HIERARCHICAL:
        changed = harmonize(gradients, factors, count, guidance);
        *opposed = project_onto_nominal(nominal, guidance);
        changed |= *opposed;
        break;
    case CONE: changed = project_onto_cone(gradients, count, guidance); break;
    case PROJECTIONS: break;
    }
    return changed;
}

/* Counts every pair of gradients that oppose each other, for both terms. */
static void count_conflicts(const Vector2 *gradients, const int *term, int count, int *conflicts)
{
    for (int m = 1; m < count; m++)
        for (int n = 0; n < m; n++)
            if (dot2(gradients[m], gradients[n]) < 0.0) {
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

/* T Euler steps, or as many as fit in the time left; guidance/flow.py for batch 1 and d = 2. */
static Sample sample_guided(Network *net, Projection projection, const Term *terms, int count, Vector2 action,
                            double left_s, int most_steps)
{
    Sample sample = {.fault = -1};
    const double begin = seconds();
    double now = begin, longest = 0.0;
    for (int k = 0; k < net->euler_steps; k++) {
        float result[6];
        net->engine->step(net, k, (float[]){(float)action.x, (float)action.y}, result);
        const Vector2 velocity = {result[0], result[1]}, along_x = {result[2], result[3]},
                      along_y = {result[4], result[5]};
        const double left = 1.0 - (double)k / net->euler_steps;
        const Vector2 estimate = add_scaled(action, left, velocity);
        Vector2 gradients[MAX_TERMS], guidance;
        double factors[MAX_TERMS];
        int term[MAX_TERMS], steering = 0;
        bool opposed;
        for (int m = 0; m < count; m++) {
            Vector2 gradient;
            sample.costs[m] = evaluate_term(&terms[m], estimate, &gradient);
            if (!isfinite(gradient.x + gradient.y)) {
                sample.action = estimate;
                sample.fault = m;
                sample.steps = k;
                return sample;
            }
            if (gradient.x != 0.0 || gradient.y != 0.0) {
                gradients[steering] = (Vector2){-gradient.x - left * dot2(along_x, gradient),
                                                -gradient.y - left * dot2(along_y, gradient)};
                factors[steering] = terms[m].factor;
                term[steering++] = m;
            }
        }
        sample.projections +=
            combine(projection, gradients, factors, steering, velocity, &guidance, &opposed);
        sample.opposed += opposed;
        count_conflicts(gradients, term, steering, sample.conflicts);
        sample.action = action =
            add_scaled(action, 1.0 / net->euler_steps, add_scaled(velocity, 1.0, guidance));
        sample.steps = k + 1;
        const double before = now;
        now = seconds();
        longest = fmax(longest, now - before);
        if (k + 1 < net->euler_steps && (now - begin + longest > left_s || k + 1 == most_steps)) {
            sample.action = add_scaled(estimate, 1.0 / net->euler_steps, guidance);
            break;
        }
    }
    return sample;
}

#endif
