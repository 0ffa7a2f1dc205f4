/* Velocity and Jacobian of the network in forward mode, included once per instruction set.
 *
 * The includer defines NAME(x) to decorate names, TARGET as a function attribute, LANES as the floats of one
 * register, ROWS as the rows whose sums fit the registers beside one row of weights, and UNROLL as the pragma
 * that says how often the innermost loop is repeated (measured; 16 registers leave no room for more than
 * once). Rows are robot-major: each robot's value, then its d tangents.
 */

#define vector NAME(vector)
#define bits NAME(bits)
#define INLINE static inline __attribute__((always_inline)) TARGET

typedef float vector __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
typedef int32_t bits __attribute__((vector_size(4 * LANES), aligned(4), may_alias));

enum { NAME(COLUMNS) = 4, NAME(BLOCK) = NAME(COLUMNS) * LANES };

INLINE vector NAME(fill)(float value) { return (vector){0} + value; }

/* e^x to 1e-7 relative: 2^n e^r with |r| <= ln 2 / 2, e^r by its Taylor series, n added to the exponent. */
INLINE vector NAME(exponential)(vector x)
{
    const float to_integer = 12582912.0f; /* 1.5 * 2^23: the sum's last bits are the rounded integer */
    const bits low = x < -87.0f;
    const bits high = x > 87.0f;
    x = (vector)((low & (bits)NAME(fill)(-87.0f)) | (high & (bits)NAME(fill)(87.0f)) |
                 (~(low | high) & (bits)x));
    vector shifted = x * 1.44269504f + to_integer;
    vector n = shifted - to_integer;
    vector r = (x - n * 0.693359375f) + n * 2.12194440e-4f; /* ln 2 in two parts */
    vector series = NAME(fill)(1.0f / 5040);
    series = series * r + 1.0f / 720;
    series = series * r + 1.0f / 120;
    series = series * r + 1.0f / 24;
    series = series * r + 1.0f / 6;
    series = series * r + 0.5f;
    series = series * r + 1.0f;
    series = series * r + 1.0f;
    return (vector)((bits)series + ((bits)shifted << 23));
}

/* sums[rows][BLOCK] = x (rows, inputs) times one block (inputs, BLOCK) of a matrix. */
INLINE void NAME(tile)(const int rows, const float *x, int stride, const float *block, int inputs, float *y)
{
    vector sum[ROWS][NAME(COLUMNS)];
#pragma GCC unroll 8
    for (int row = 0; row < rows; row++)
#pragma GCC unroll 4
        for (int c = 0; c < NAME(COLUMNS); c++)
            sum[row][c] = NAME(fill)(0.0f);
    UNROLL
    for (int i = 0; i < inputs; i++, block += NAME(BLOCK)) {
#pragma GCC unroll 8
        for (int row = 0; row < rows; row++)
#pragma GCC unroll 4
            for (int c = 0; c < NAME(COLUMNS); c++)
                sum[row][c] += x[row * stride + i] * *(const vector *)(block + c * LANES);
    }
#pragma GCC unroll 8
    for (int row = 0; row < rows; row++)
#pragma GCC unroll 4
        for (int c = 0; c < NAME(COLUMNS); c++)
            *(vector *)(y + row * stride + c * LANES) = sum[row][c];
}

/* y = x W for all rows; x and y have the same stride. */
static TARGET void NAME(product)(const float *x, int rows, int stride, const Layer *layer, int inputs,
                                 float *y)
{
    for (int column = 0; column < layer->padded; column += NAME(BLOCK)) {
        const float *block = layer->matrix + (size_t)column * inputs;
        for (int row = 0, step; row < rows; row += step) {
            const float *from = x + (size_t)row * stride;
            float *to = y + (size_t)row * stride + column;
            const int left = rows - row;
            /* The last two tiles share what is left: a tile of one row leaves the multipliers idle. */
            step = left <= ROWS ? left : left < 2 * ROWS ? (left + 1) / 2 : ROWS;
            switch (step) {
            case 1: NAME(tile)(1, from, stride, block, inputs, to); break;
            case 2: NAME(tile)(2, from, stride, block, inputs, to); break;
#if ROWS > 3
            case 3: NAME(tile)(3, from, stride, block, inputs, to); break;
            case 4: NAME(tile)(4, from, stride, block, inputs, to); break;
#endif
#if ROWS > 5
            case 5: NAME(tile)(5, from, stride, block, inputs, to); break;
#endif
            default: NAME(tile)(ROWS, from, stride, block, inputs, to);
            }
        }
    }
}

/* One robot's rows after the activation: the value, and its slope times so many tangents. */
static TARGET void NAME(activate)(const Network *net, const float *value, const float *offset,
                                  const float *tangents, int count, int stride, int padded, float *after,
                                  int after_stride)
{
    for (int j = 0; j < padded; j += LANES) {
        vector x = *(const vector *)(value + j) + *(const vector *)(offset + j);
        vector activated, slope;
        if (net->silu) {
            vector sigmoid = 1.0f / (1.0f + NAME(exponential)(-x));
            activated = x * sigmoid;
            slope = sigmoid + activated * (1.0f - sigmoid);
        } else {
            activated = 1.0f - 2.0f / (1.0f + NAME(exponential)(2.0f * x));
            slope = 1.0f - activated * activated;
        }
        *(vector *)(after + j) = activated;
        for (int i = 0; i < count; i++)
            *(vector *)(after + (size_t)(1 + i) * after_stride + j) =
                slope * *(const vector *)(tangents + (size_t)i * stride + j);
    }
}

INLINE float NAME(dot)(const float *x, const float *y, int padded)
{
    vector sums = NAME(fill)(0.0f);
    for (int j = 0; j < padded; j += LANES)
        sums += *(const vector *)(x + j) * *(const vector *)(y + j);
    float sum = 0.0f;
    for (int lane = 0; lane < LANES; lane++)
        sum += sums[lane];
    return sum;
}

static TARGET void NAME(observe)(Network *net, const float *observation)
{
    const Layer *first = &net->layer[0];
    for (int b = 0; b < net->batch; b++) {
        float *observed = net->observed + (size_t)b * first->padded;
        memset(observed, 0, sizeof(float) * first->padded);
        for (int i = 0; i < net->observation_dim; i++) {
            const float *row = first->matrix + (size_t)i * first->padded;
            float part = observation[(size_t)b * net->observation_dim + i];
            for (int j = 0; j < first->padded; j += LANES)
                *(vector *)(observed + j) += part * *(const vector *)(row + j);
        }
    }
}

/* The first layer: its tangents before the activation are the action's weight rows themselves. */
static TARGET void NAME(enter)(Network *net, int k, int tangents, const float *action, int stride)
{
    const int d = net->action_dim, padded = net->layer[0].padded;
    for (int b = 0; b < net->batch; b++) {
        float *value = net->before + (size_t)b * (1 + tangents) * stride;
        memcpy(value, net->observed + (size_t)b * padded, sizeof(float) * padded);
        for (int i = 0; i < d; i++)
            for (int j = 0; j < padded; j += LANES)
                *(vector *)(value + j) +=
                    action[b * d + i] * *(const vector *)(net->action_rows + (size_t)i * padded + j);
        NAME(activate)
        (net, value, net->time_parts + (size_t)k * padded, net->action_rows, tangents, padded, padded,
         net->after + (size_t)b * (1 + tangents) * stride, stride);
    }
}

/* result (B, 1 + tangents, d): each robot's velocity at the beginning of step k, then dv/da_j: for every j, or
 * for none. */
static TARGET void NAME(step)(Network *net, int k, int tangents, const float *action, float *result)
{
    const int d = net->action_dim, each = 1 + tangents, rows = net->batch * each, stride = net->stride;
    NAME(enter)(net, k, tangents, action, stride);
    for (int l = 1; l < net->layers; l++) {
        const Layer *layer = &net->layer[l];
        NAME(product)(net->after, rows, stride, layer, layer[-1].width, net->before);
        for (int row = 0; row < rows; row += each) {
            const float *value = net->before + (size_t)row * stride;
            NAME(activate)
            (net, value, layer->bias, value + stride, tangents, stride, layer->padded,
             net->after + (size_t)row * stride, stride);
        }
    }
    const int padded = net->layer[net->layers - 1].padded;
    for (int row = 0; row < rows; row++) {
        const int tangent = row % each - 1;
        for (int i = 0; i < d; i++) {
            const float product =
                NAME(dot)(net->after + (size_t)row * stride, net->output + (size_t)i * padded, padded);
            const float along = tangent < 0 ? action[row / each * d + i] : (float)(tangent == i);
            result[row * d + i] =
                product + net->prior_gain[k] * along + (tangent < 0 ? net->output_bias[i] : 0.0f);
        }
    }
}

static const Engine NAME(engine) = {ENGINE_NAME, NAME(BLOCK), NAME(observe), NAME(step)};

#undef vector
#undef bits
#undef INLINE
#undef NAME
#undef TARGET
#undef LANES
#undef ROWS
#undef UNROLL
#undef ENGINE_NAME
