/* Vectors of a few components: actions, and places in the plane or in space. */
#ifndef KERNEL_VECTORS_H
#define KERNEL_VECTORS_H

#include <math.h>
#include <stdbool.h>

#define MAX_ACTION 4
#define MAX_TERMS 32

/* Everything is compiled once for each d, the action's size: loops over it are unrolled. */
#define INLINE static inline __attribute__((always_inline))

/* Components beyond its size are never read. */
typedef struct {
    double at[MAX_ACTION];
} Vector;

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

INLINE Vector negative(const int d, const Vector *a)
{
    Vector vector;
    for (int i = 0; i < d; i++)
        vector.at[i] = -a->at[i];
    return vector;
}

INLINE double sum_of(const int d, const Vector *a)
{
    double sum = a->at[0];
    for (int i = 1; i < d; i++)
        sum += a->at[i];
    return sum;
}

/* The newest hypot differs in how it tells of overflow alone; with this one wheels load on older systems. */
#if defined(__GLIBC__) && defined(__x86_64__)
__asm__(".symver hypot, hypot@GLIBC_2.2.5");
#elif defined(__GLIBC__) && defined(__aarch64__)
__asm__(".symver hypot, hypot@GLIBC_2.17");
#endif

/* Its length, which does not overflow before it must. */
INLINE double length_of(const int d, const Vector *a)
{
    double length = fabs(a->at[0]);
    for (int i = 1; i < d; i++)
        length = hypot(length, a->at[i]);
    return length;
}

#endif
