/* Two hidden layers' products as the kernel computes them, with weights stored in 32 and in 16 bits.
 *
 * Sums are of 32 bits in both. Prints a line for 1 row (a velocity alone) and for 3 (with its two tangents): the
 * rows, and the best time of STEPS products of each layer in microseconds, with 32 bits and with 16. Compiled with
 * -DWIDTH for one width of the layers.
 */
#define _GNU_SOURCE
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#if defined(__AVX512F__)
#include <immintrin.h>
enum { LANES = 16 };
#define WIDEN(from) (vector)_mm512_cvtph_ps(_mm256_loadu_si256((const __m256i *)(from)))
#elif defined(__F16C__)
#include <immintrin.h>
enum { LANES = 8 };
#define WIDEN(from) (vector)_mm256_cvtph_ps(_mm_loadu_si128((const __m128i *)(from)))
#elif defined(__aarch64__)
#include <arm_neon.h>
enum { LANES = 4 };
#define WIDEN(from) (vector)vcvt_f32_f16(vld1_f16((const float16_t *)(from)))
#else
#error "this processor does not convert 16 bits"
#endif

enum { COLUMNS = 4, BLOCK = COLUMNS * LANES, LAYERS = 2, STEPS = 10, ROUNDS = 300, MOST_ROWS = 3 };
typedef float vector __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
typedef uint16_t half;

static float *whole[LAYERS], x[MOST_ROWS * WIDTH], y[MOST_ROWS * WIDTH];
static half *halves[LAYERS];

static inline __attribute__((always_inline)) void product(int rows, const float *weights, const half *narrow)
{
    for (int column = 0; column < WIDTH; column += BLOCK) {
        vector sum[MOST_ROWS][COLUMNS] = {0};
#pragma GCC unroll 2
        for (int i = 0; i < WIDTH; i++) {
            const size_t at = (size_t)column * WIDTH + (size_t)i * BLOCK;
#pragma GCC unroll 4
            for (int c = 0; c < COLUMNS; c++) {
                const vector weight =
                    narrow ? WIDEN(narrow + at + c * LANES) : *(const vector *)(weights + at + c * LANES);
#pragma GCC unroll 3
                for (int row = 0; row < rows; row++)
                    sum[row][c] += x[row * WIDTH + i] * weight;
            }
        }
        for (int row = 0; row < rows; row++)
            for (int c = 0; c < COLUMNS; c++)
                *(vector *)(y + row * WIDTH + column + c * LANES) = sum[row][c];
    }
    __asm__ volatile("" ::: "memory");
}

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void pass(int rows, int narrow)
{
    for (int step = 0; step < STEPS; step++)
        for (int layer = 0; layer < LAYERS; layer++)
            switch (2 * (rows == 1) + narrow) {
            case 0: product(3, whole[layer], NULL); break;
            case 1: product(3, NULL, halves[layer]); break;
            case 2: product(1, whole[layer], NULL); break;
            default: product(1, NULL, halves[layer]);
            }
}

static void compare(int rows)
{
    double best[2] = {1e9, 1e9};
    for (int round = 0; round < 2 * ROUNDS; round++) {
        pass(rows, round % 2);
        const double begin = seconds();
        pass(rows, round % 2);
        const double taken = seconds() - begin;
        if (taken < best[round % 2])
            best[round % 2] = taken;
    }
    printf("%d %.3f %.3f\n", rows, 1e6 * best[0], 1e6 * best[1]);
}

int main(void)
{
    for (int layer = 0; layer < LAYERS; layer++) {
        whole[layer] = aligned_alloc(64, sizeof(float) * WIDTH * WIDTH);
        halves[layer] = aligned_alloc(64, sizeof(half) * WIDTH * WIDTH);
        for (int i = 0; i < WIDTH * WIDTH; i++) {
            whole[layer][i] = 0.0625f;
            halves[layer][i] = 0x2c00; /* the same */
        }
    }
    for (int i = 0; i < MOST_ROWS * WIDTH; i++)
        x[i] = 1e-3f * (float)(i % 100);
    compare(1);
    compare(3);
    return 0;
}
