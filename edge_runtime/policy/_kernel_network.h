/* The network as the kernel holds it, and what one instruction set offers to compute it. */
#ifndef KERNEL_NETWORK_H
#define KERNEL_NETWORK_H

#define MAX_LAYERS 16

typedef struct Network Network;

/* The pass compiled for one instruction set; see _kernel_pass.h. */
typedef struct {
    const char *name;
    int block; /* columns that a product computes at once: widths are padded to a multiple of it */
    void (*observe)(Network *, const float *observation);
    void (*step)(Network *, int k, int tangents, const float *action, float *result);
} Engine;

/* One step of a flow, see flow_steps.py. */
typedef struct {
    double tau, prior, keep, gain, ahead;
} FlowStep;

typedef struct {
    int width;     /* outputs, without padding */
    int padded;    /* outputs, with padding */
    float *matrix; /* blocks of columns one after the other, each (inputs, block); for the first layer the
                      observation's rows */
    float *bias;   /* (padded) */
} Layer;

struct Network {
    const Engine *engine;
    int silu; /* else tanh */
    int action_dim, observation_dim, steps, batch, layers;
    Layer layer[MAX_LAYERS]; /* the hidden layers */
    float *action_rows;      /* (d, padded): the action's rows of the first layer */
    float *time_parts;       /* (T, padded): what flow time adds to the first layer, bias included */
    float *output;           /* (d, padded): the last layer, transposed */
    float *output_bias;      /* (d) */
    float *prior_gain;       /* (T) */
    FlowStep *schedule;      /* (T) */
    float *observed;         /* (B, padded): what the observation adds to the first layer */
    int stride;              /* the widest padded layer */
    float *before, *after;   /* (B (1 + d), stride): each robot's value and tangents around an activation */
};

#endif
