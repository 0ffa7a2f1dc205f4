/* What one tick fixes for each objective: its own drift and the places around, by the robot's linear motion
 * model. edge_runtime/motion/outlook.py in C, and the state of a robot's team in plain numbers. */
#ifndef KERNEL_OUTLOOK_H
#define KERNEL_OUTLOOK_H

#include <string.h>

#include "_kernel_costs.h"

/* Python reads names and limits from the module: nothing of this is written twice. */
typedef enum {
    SPEED_LIMIT,
    SAFETY_MARGIN,
    OBSTACLE_MARGIN,
    TRACKED_MARGIN,
    ATTRACTION,
    GEOFENCE,
    SPACING,
    CLUSTERING,
    SPATIAL_ORDER,
    PASSING,
    PYTHON,
    KINDS
} Kind;
typedef enum { NONE, HIERARCHICAL, CONE, PROJECTIONS } Projection;

static const char *const projection_names[PROJECTIONS] = {
    [NONE] = "none", [HIERARCHICAL] = "hierarchical", [CONE] = "cone"};

/* What a kind of objective is called, what it costs, and how many numbers it states: at least `fewest`, and
 * more only where they are `listed`: a place, or robots in their order. */
static const struct {
    const char *name;
    Cost cost;
    int fewest;
    bool listed;
} kinds[KINDS] = {
    [SPEED_LIMIT] = {"speed_limit", SPEED, 2, false},            /* limit, buffer */
    [SAFETY_MARGIN] = {"safety_margin", CLEARANCE, 1, false},     /* distance */
    [OBSTACLE_MARGIN] = {"obstacle_margin", CLEARANCE, 1, false}, /* distance */
    [TRACKED_MARGIN] = {"tracked_margin", CLEARANCE, 2, false},   /* distance, the object's place */
    [ATTRACTION] = {"attraction", MIDDLE, 2, false},             /* pull, the object's place */
    [GEOFENCE] = {"geofence", CLEARANCE, 3, true},                /* distance, centre */
    [SPACING] = {"spacing", DISTANCE, 1, false},                  /* distance */
    [CLUSTERING] = {"clustering", CLUSTER, 2, false},             /* radius, distance of what coincides */
    [SPATIAL_ORDER] = {"spatial_order", ORDER, 2, true},          /* gap, pull; robots from left to right */
    [PASSING] = {"passing", ORDER, 4, true},                      /* clearance, pull, margin, reach; robots */
    [PYTHON] = {"python", OWN, 0, false},
};

/* Along one axis: v' = velocity_decay v + velocity_row . u, p' = p + position_decay v + position_row . u */
typedef struct {
    double position_decay, velocity_decay;
    const double *position_row, *velocity_row; /* (d) */
} Axis;

/* One objective as it stands in every tick. */
typedef struct {
    Kind kind;
    bool preference;
    double factor, weight;
    double horizon_s;
    double gain;                  /* of the motion that the cost is of */
    double rows[3 * MAX_ACTION];  /* (dims, d): its derivatives in units of that */
    Axis axes[3];                 /* (dims): the robot's model, so far ahead */
    int count;
    const double *numbers; /* (count): see `kinds` */
} Objective;

typedef struct {
    Projection projection;
    bool steers;     /* along the flow */
    int dims, count; /* of the robot's world, 2 or 3, and of its objectives */
    int rounds;      /* in which preferences correct a finished action; below 0 there is no correction, */
    double rate;     /* by this share of a Newton step each, */
    int steps;       /* and in so many at most requirements */
    Objective objectives[MAX_TERMS];
} Steering;

/* How many things a robot sees. */
typedef struct {
    int mates, obstacles, tracked;
} Sight;

/* Numbers of one view: the robot, its obstacles (x, y), tracked objects, teammates with their actions, and how
 * far preferences may move the finished action. */
INLINE int robot_size(int dims) { return 1 + 2 * dims; } /* number or presence, position, velocity */
INLINE Py_ssize_t view_size(int d, int dims, const Sight *sight)
{
    return robot_size(dims) + 2 * (Py_ssize_t)sight->obstacles +
           robot_size(dims) * (Py_ssize_t)sight->tracked +
           (robot_size(dims) + d) * (Py_ssize_t)sight->mates + 1;
}

/* The most points of one term. */
static int most_points(const Sight *sight)
{
    return 1 + (sight->mates > sight->obstacles ? sight->mates : sight->obstacles);
}

/* Reads a whole number between two others; false if it is none. */
static bool read_count(double number, int least, int most, int *count)
{
    if (!(number >= least && number <= most && number == (int)number))
        return false;
    *count = (int)number;
    return true;
}

static bool read_axes(const double *numbers, int d, int dims, Objective *objective)
{
    const bool moves = kinds[objective->kind].cost == SPEED;
    objective->gain = numbers[moves];
    numbers += 2;
    for (int i = 0; i < dims; i++, numbers += 2 + 2 * d) {
        objective->axes[i] = (Axis){numbers[0], numbers[1], numbers + 2, numbers + 2 + d};
        const double *row = moves ? objective->axes[i].velocity_row : objective->axes[i].position_row;
        for (int j = 0; j < d; j++)
            objective->rows[i * d + j] = row[j] / objective->gain;
    }
    return true;
}

/* Reads one objective, (kind, factor, weight, preference, horizon, counts of what follows; model, numbers), from
 * where *next points to, and has *next point behind it; false if there is none. */
static bool read_objective(const double **next, const double *end, int d, int dims, Objective *objective)
{
    const double *head = *next;
    int kind, preference, model;
    if (end - head < 7 || !read_count(head[0], 0, KINDS - 1, &kind) || !read_count(head[3], 0, 1, &preference))
        return false;
    const Py_ssize_t left = end - head - 7;
    const int most = left < 1 << 20 ? (int)left : 1 << 20, size = 2 + dims * (2 + 2 * d);
    if (!read_count(head[5], 0, most, &model) || !read_count(head[6], 0, most - model, &objective->count))
        return false;
    const int fewest = kinds[kind].fewest;
    if (model != (kind == PYTHON ? 0 : size) || objective->count < fewest ||
        (objective->count > fewest && !kinds[kind].listed))
        return false;
    if ((kind == GEOFENCE && objective->count > 1 + dims) ||
        ((kind == OBSTACLE_MARGIN || kind == PASSING) && dims != 2))
        return false;
    objective->kind = (Kind)kind;
    objective->preference = preference;
    objective->factor = head[1];
    objective->weight = head[2];
    objective->horizon_s = head[4];
    objective->numbers = head + 7 + model;
    *next = objective->numbers + objective->count;
    return kind == PYTHON || read_axes(head + 7, d, dims, objective);
}

/* Reads (projection, steers, count, dims, rounds, rate, steps) and that many objectives; the place of the one
 * that does not hold what its kind takes, -1 if it is the head, and `count` if all is well. */
static int read_steering(const double *numbers, Py_ssize_t size, int d, Steering *steering)
{
    const double *next = numbers + 7, *end = numbers + size;
    int projection, steers;
    if (size < 7 || !read_count(numbers[0], 0, PROJECTIONS - 1, &projection) ||
        !read_count(numbers[1], 0, 1, &steers) || !read_count(numbers[2], 0, MAX_TERMS, &steering->count) ||
        !read_count(numbers[3], 2, 3, &steering->dims) ||
        !read_count(numbers[4], -1, 1000, &steering->rounds) ||
        !read_count(numbers[6], 1, 1000, &steering->steps))
        return -1;
    steering->projection = (Projection)projection;
    steering->steers = steers;
    steering->rate = numbers[5];
    for (int m = 0; m < steering->count; m++)
        if (!read_objective(&next, end, d, steering->dims, &steering->objectives[m]))
            return m;
    return steering->count;
}

/* The place at which something will be that moves under an action, or under none. */
static void predict(const Objective *objective, int d, int dims, const double *position,
                    const double *velocity, const double *action, double *place)
{
    for (int i = 0; i < dims; i++) {
        const Axis *axis = &objective->axes[i];
        place[i] = position[i] + axis->position_decay * velocity[i];
        for (int j = 0; action != NULL && j < d; j++)
            place[i] += axis->position_row[j] * action[j];
    }
}

/* Where a robot stands in an order, or -1. */
static int place_in(const double *order, int count, double robot)
{
    for (int i = 0; i < count; i++)
        if (order[i] == robot)
            return i;
    return -1;
}

/* One of a pair that must change sides along x: adds it unless they may go on as they do. */
static int add_ordered(const Objective *objective, int own, int other, const double *drift,
                       const double *there, Point *point)
{
    const double *numbers = objective->numbers;
    if (objective->kind == SPATIAL_ORDER) {
        *point = (Point){{there[0]}, own > other ? 1.0 : -1.0};
        return 1;
    }
    const double dx = drift[0] - there[0], dy = drift[1] - there[1];
    if (dx >= numbers[2] || dx * dx + dy * dy >= numbers[3] * numbers[3] || other > own)
        return 0;
    *point = (Point){{there[1]}, -1.0};
    return 1;
}

/* Adds what an objective sees of the teammates; how many points that is. */
static int see_mates(const Objective *objective, int d, int dims, double own, const double *drift,
                     const double *mate, int mates, Point *points)
{
    const int fewest = kinds[objective->kind].fewest, listed = objective->count - fewest;
    const double *order = objective->numbers + fewest;
    const bool ordered = kinds[objective->kind].cost == ORDER;
    const int rank = ordered ? place_in(order, listed, own) : 0;
    int count = 0;
    for (int n = 0; rank >= 0 && n < mates; n++, mate += robot_size(dims) + d) {
        double there[3] = {0.0};
        predict(objective, d, dims, mate + 1, mate + 1 + dims, mate + 1 + 2 * dims, there);
        if (!ordered) {
            Point *point = &points[count++];
            memcpy(point->at, there, sizeof there);
            point->mark = objective->kind == CLUSTERING ? mate[0] : copysign(1.0, own - mate[0]);
            continue;
        }
        const int other = place_in(order, listed, mate[0]);
        if (other >= 0)
            count += add_ordered(objective, rank, other, drift, there, &points[count]);
    }
    return count;
}

/* Adds a tracked object, if the robot knows where it is; how many points that is. */
static int see_object(const Objective *objective, int dims, const Sight *sight, const double *tracked, Point *point)
{
    const double place = objective->numbers[1];
    if (!(place >= 0.0 && place < sight->tracked))
        return 0;
    tracked += (int)place * robot_size(dims);
    for (int i = 0; i < dims; i++)
        point->at[i] = tracked[1 + i] + objective->horizon_s * tracked[1 + dims + i];
    point->mark = 1.0;
    return tracked[0] != 0.0;
}

/* Adds the points that an objective is about. */
static int see(const Objective *objective, int d, int dims, const Sight *sight, const double *view,
               const double *drift, Point *points)
{
    const double *obstacles = view + robot_size(dims), *tracked = obstacles + 2 * sight->obstacles;
    const double *mate = tracked + robot_size(dims) * sight->tracked;
    switch (objective->kind) {
    case SPEED_LIMIT:
    case PYTHON: return 0;
    case OBSTACLE_MARGIN:
        for (int n = 0; n < sight->obstacles; n++)
            points[n] = (Point){{obstacles[2 * n], obstacles[2 * n + 1]}, 1.0};
        return sight->obstacles;
    case TRACKED_MARGIN: return see_object(objective, dims, sight, tracked, points);
    case ATTRACTION:
        if (!see_object(objective, dims, sight, tracked, points))
            return 0;
        return 1 + see_mates(objective, d, dims, view[0], drift, mate, sight->mates, points + 1);
    case GEOFENCE:
        memcpy(points->at, objective->numbers + 1, sizeof(double) * (objective->count - 1));
        points->mark = 1.0;
        return 1;
    default:
        return see_mates(objective, d, dims, view[0], drift, mate, sight->mates, points);
    }
}

/* What an objective costs in the tick of this view; points has room for `most_points`. */
static Term outlook(const Objective *objective, int d, int dims, const Sight *sight, const double *view,
                    Point *points)
{
    const double *numbers = objective->numbers, *position = view + 1, *velocity = view + 1 + dims;
    Term term = {.cost = kinds[objective->kind].cost,
                 .preference = objective->preference,
                 .factor = objective->factor,
                 .weight = objective->weight,
                 .dims = dims,
                 .gain = objective->gain,
                 .rows = objective->rows,
                 .unit = 1.0,
                 .own = view[0],
                 .points = points};
    if (objective->kind == PYTHON)
        return term;
    term.limit = numbers[0];
    if (term.cost == SPEED) {
        term.limit -= numbers[1];
        for (int i = 0; i < dims; i++)
            term.drift[i] = objective->axes[i].velocity_decay * velocity[i];
        return term;
    }
    predict(objective, d, dims, position, velocity, NULL, term.drift);
    term.count = see(objective, d, dims, sight, view, term.drift, points);
    if (term.cost == CLUSTER || term.cost == ORDER)
        term.most = numbers[1];
    if (objective->kind == GEOFENCE)
        term.dims = objective->count - 1;
    if (term.cost == ORDER) {
        const int axis = objective->kind == PASSING;
        term.dims = 1;
        term.drift[0] = term.drift[axis];
        term.rows = objective->rows + axis * d;
    }
    return term;
}

/* The same in SI units, operation for operation as Python corrects a finished action: so corrections of earlier
 * logs, which Python computed, repeat bit for bit. */
static Term in_si_units(Term term, const Objective *objective)
{
    term.unit = term.gain;
    if (term.cost == SPEED) {
        term.limit = objective->numbers[0];
        term.slack = objective->numbers[1];
    }
    return term;
}

#endif
