/* How gradients become one guidance vector: guidance/projection.py in C; what each step means stands there. */
#ifndef KERNEL_PROJECTION_H
#define KERNEL_PROJECTION_H

#include "_kernel_outlook.h"

#define FEASIBLE -1e-12

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
    const double length = length_of(d, vector);
    for (int m = 0; m < count; m++)
        if (!(dot(d, vector, &gradients[m]) >= FEASIBLE * length * length_of(d, &gradients[m])))
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

#endif
