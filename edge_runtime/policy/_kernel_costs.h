/* The built-in objectives' costs of a predicted motion, and their gradients with respect to the action:
 * edge_runtime/objectives in C, for the same numbers. What each means is explained there. */
#ifndef KERNEL_COSTS_H
#define KERNEL_COSTS_H

#include "_kernel_vectors.h"

#define TWO_PI 6.283185307179586

typedef enum { SPEED, CLEARANCE, DISTANCE, CLUSTER, ORDER, MIDDLE, OWN } Cost;

/* Where something will be that a cost is about. */
typedef struct {
    double at[3];
    double mark; /* CLEARANCE and DISTANCE: the side along x on which to leave it, if the robot is there;
                    ORDER: the side of it on which the robot is to be; CLUSTER: whose place it is;
                    MIDDLE: the first is where the middle is to be, all others are teammates */
} Point;

/* One objective in one tick. */
typedef struct {
    Cost cost;
    bool preference;
    double factor, weight; /* eta lambda, and lambda */
    int dims;              /* of the motion that the cost is of: along one axis, in the plane or in space */
    double drift[3];       /* that motion under a zero action, */
    double gain;           /* what an action adds to it at most, */
    const double *rows;    /* (dims, d) and its derivatives in units of `gain` */
    double unit;           /* slopes are in units of 1 / unit */
    double limit, slack;   /* of speed, distance, radius, gap or pull; and what is taken off it */
    double most;           /* ORDER: the strongest pull; CLUSTER: nearer than this, places are one */
    double own;            /* the robot's number */
    int count;
    const Point *points;
} Term;

/* Each gives its slope over the motion, zero before the call. */

INLINE double speed_cost(const int dims, const Term *term, const Vector *velocity, Vector *slope)
{
    const double speed = sqrt(dot(dims, velocity, velocity)), excess = speed - term->limit + term->slack;
    if (excess <= 0.0)
        return 0.0;
    const double cure = excess / term->gain;
    *slope = add_scaled(dims, slope, cure / (term->unit * speed), velocity);
    return 0.5 * cure * cure;
}

INLINE Vector apart_from(const int dims, const Vector *position, const Point *point)
{
    Vector apart;
    for (int i = 0; i < dims; i++)
        apart.at[i] = position->at[i] - point->at[i];
    return apart;
}

/* The cost of what is missing to the limit, and the push that cures it. */
INLINE double push_apart(const int dims, const Term *term, Vector apart, double distance, double mark,
                         Vector *slope)
{
    const double cure = (term->limit - distance) / term->gain;
    if (distance == 0.0) {
        apart.at[0] = mark;
        distance = 1.0;
    }
    *slope = add_scaled(dims, slope, -cure / (term->unit * distance), &apart);
    return 0.5 * cure * cure;
}

INLINE double clearance_cost(const int dims, const Term *term, const Vector *position, Vector *slope)
{
    double cost = 0.0;
    for (int n = 0; n < term->count; n++) {
        const Vector apart = apart_from(dims, position, &term->points[n]);
        const double square = dot(dims, &apart, &apart);
        if (square < term->limit * term->limit)
            cost += push_apart(dims, term, apart, sqrt(square), term->points[n].mark, slope);
    }
    return cost;
}

INLINE double distance_cost(const int dims, const Term *term, const Vector *position, Vector *slope)
{
    double nearest = INFINITY, mark = 1.0;
    Vector away = {{0.0}};
    for (int n = 0; n < term->count; n++) {
        const Vector apart = apart_from(dims, position, &term->points[n]);
        const double square = dot(dims, &apart, &apart);
        if (square < nearest) {
            nearest = square;
            away = apart;
            mark = term->points[n].mark;
        }
    }
    return isinf(nearest) ? 0.0 : push_apart(dims, term, away, sqrt(nearest), mark, slope);
}

/* The direction of a member of the cluster from its centre; in the order of their numbers where it is there. */
INLINE Vector outward(const int dims, const Term *term, double number, Vector from, double distance)
{
    if (distance < term->most) {
        int before = term->own < number;
        for (int n = 0; n < term->count; n++)
            before += term->points[n].mark < number;
        const double angle = TWO_PI * before / (term->count + 1);
        from = (Vector){{cos(angle), sin(angle), 0.0}};
        distance = 1.0;
    }
    for (int i = 0; i < dims; i++)
        from.at[i] /= distance;
    return from;
}

INLINE double cluster_cost(const int dims, const Term *term, const Vector *position, Vector *slope)
{
    if (term->count == 0)
        return 0.0;
    const int count = term->count + 1;
    Vector middle = {{0.0}}, own = {{0.0}}, mean = {{0.0}};
    double total = 0.0;
    for (int i = 0; i < dims; i++) {
        double sum = 0.0;
        for (int n = 0; n < term->count; n++)
            sum += term->points[n].at[i];
        middle.at[i] = (position->at[i] + sum) / count;
    }
    for (int n = -1; n < term->count; n++) {
        Vector from;
        for (int i = 0; i < dims; i++)
            from.at[i] = (n < 0 ? position->at[i] : term->points[n].at[i]) - middle.at[i];
        const double distance = sqrt(dot(dims, &from, &from));
        const Vector out = outward(dims, term, n < 0 ? term->own : term->points[n].mark, from, distance);
        total += distance;
        mean = add_scaled(dims, &mean, 1.0, &out);
        if (n < 0)
            own = out;
    }
    const double cure = (total / count - term->limit) / term->gain, push = cure / (term->unit * count);
    for (int i = 0; i < dims; i++)
        slope->at[i] = push * (own.at[i] - mean.at[i] / count);
    return 0.5 * cure * cure;
}

INLINE double order_cost(const Term *term, const Vector *position, Vector *slope)
{
    double cost = 0.0;
    for (int n = 0; n < term->count; n++) {
        const double side = term->points[n].mark;
        const double cure = (term->limit - side * (position->at[0] - term->points[n].at[0])) / term->gain;
        if (cure > 0.0) {
            const double pull = fmin(cure, term->most);
            cost += pull * (cure - 0.5 * pull);
            slope->at[0] -= side * pull / term->unit;
        }
    }
    return cost;
}

INLINE double middle_cost(const int dims, const Term *term, const Vector *position, Vector *slope)
{
    const int count = term->count; /* the object stands for the robot itself */
    if (count == 0)
        return 0.0;
    Vector apart;
    for (int i = 0; i < dims; i++) {
        double sum = 0.0;
        for (int n = 1; n < count; n++)
            sum += term->points[n].at[i];
        apart.at[i] = (position->at[i] + sum) / count - term->points[0].at[i];
    }
    const double distance = sqrt(dot(dims, &apart, &apart)), cure = distance / term->gain;
    const double pull = fmin(cure, term->limit);
    *slope = add_scaled(dims, slope, pull / (term->unit * (distance == 0.0 ? 1.0 : distance)), &apart);
    return count * pull * (cure - 0.5 * pull);
}

/* A term's cost and its gradient with respect to the action. */
INLINE double evaluate_in(const int d, const int dims, const Term *term, const Vector *action,
                          Vector *gradient)
{
    Vector motion, slope = {{0.0}};
    for (int i = 0; i < dims; i++) {
        const double *row = term->rows + i * d;
        double share = row[0] * action->at[0];
        for (int j = 1; j < d; j++)
            share += row[j] * action->at[j];
        motion.at[i] = term->drift[i] + term->gain * share;
    }
    double cost = 0.0;
    switch (term->cost) {
    case SPEED: cost = speed_cost(dims, term, &motion, &slope); break;
    case CLEARANCE: cost = clearance_cost(dims, term, &motion, &slope); break;
    case DISTANCE: cost = distance_cost(dims, term, &motion, &slope); break;
    case CLUSTER: cost = cluster_cost(dims, term, &motion, &slope); break;
    case ORDER: cost = order_cost(term, &motion, &slope); break;
    case MIDDLE: cost = middle_cost(dims, term, &motion, &slope); break;
    case OWN: break;
    }
    for (int j = 0; j < d; j++) {
        gradient->at[j] = term->rows[j] * term->unit * slope.at[0];
        for (int i = 1; i < dims; i++)
            gradient->at[j] += term->rows[i * d + j] * term->unit * slope.at[i];
    }
    return cost;
}

INLINE double evaluate_term(const int d, const Term *term, const Vector *action, Vector *gradient)
{
    switch (term->dims) {
    case 1: return evaluate_in(d, 1, term, action, gradient);
    case 2: return evaluate_in(d, 2, term, action, gradient);
    default: return evaluate_in(d, 3, term, action, gradient);
    }
}

#endif
