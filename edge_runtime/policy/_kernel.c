/* The compiled kernel: one flow network, its pass chosen for this processor at load.
 *
 * Portable: GCC's and Clang's vector types, compiled for several instruction sets side by side, so that a
 * wheel built anywhere runs as fast as one built on the robot. The interpreter's lock is kept during a
 * pass: giving it up for a tenth of a millisecond can cost 5 ms to get back.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Of the numbers that cross the border to Python; compiled_policy.py asks for the same. */
#define INTERFACE 7

#include "_kernel_guidance.h"
#include "_kernel_network.h"

#if defined(__x86_64__)
#define NAME(x) x##_avx512
#define TARGET __attribute__((target("avx512f,avx2,fma")))
#define LANES 16
#define ROWS 6
#define UNROLL _Pragma("GCC unroll 2")
#define ENGINE_NAME "avx512"
#include "_kernel_pass.h"

#define NAME(x) x##_avx2
#define TARGET __attribute__((target("avx2,fma")))
#define LANES 8
#define ROWS 3
#define UNROLL _Pragma("GCC unroll 1")
#define ENGINE_NAME "avx2"
#include "_kernel_pass.h"
#endif

/* What every compiler of the platform targets: SSE2 on x86-64, NEON with 32 registers on aarch64. */
#define NAME(x) x##_baseline
#define TARGET
#define LANES 4
#if defined(__aarch64__)
#define ROWS 5 /* with six, compilers keep sums on the stack */
#define UNROLL _Pragma("GCC unroll 2")
#define ENGINE_NAME "neon"
#else
#define ROWS 3
#define UNROLL _Pragma("GCC unroll 1")
#define ENGINE_NAME "baseline"
#endif
#include "_kernel_pass.h"

/* The engines that this processor can run, fastest first, ended by NULL. */
static const Engine *const *engines(void)
{
    static const Engine *usable[4];
    int count = 0;
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("fma"))
        usable[count++] = &engine_avx512;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        usable[count++] = &engine_avx2;
#endif
    usable[count++] = &engine_baseline;
    usable[count] = NULL;
    return usable;
}

typedef struct {
    PyObject_HEAD Network net;
    Py_buffer action, result; /* the arrays that a step reads and writes, looked up once */
    void *scratch;            /* of a sample: grows to what the largest needed */
    size_t scratch_size;
    bool sampling;
} NetworkObject;

/* A view of an array's numbers; false with an exception set unless it has that format and size. */
static bool view(PyObject *array, const char *format, Py_ssize_t count, const char *name, Py_buffer *buffer)
{
    if (PyObject_GetBuffer(array, buffer, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) < 0)
        return false;
    if (strcmp(buffer->format, format) == 0 && buffer->len == count * buffer->itemsize)
        return true;
    PyErr_Format(PyExc_ValueError, "%s must be %zd contiguous numbers of format %s, got %zd of format %s",
                 name, count, format, buffer->len / buffer->itemsize, buffer->format);
    PyBuffer_Release(buffer);
    return false;
}

static float *zeros(size_t count)
{
    const size_t size = (count * sizeof(float) + 63) / 64 * 64;
    float *memory = aligned_alloc(64, size);
    if (memory == NULL)
        PyErr_NoMemory();
    else
        memset(memory, 0, size);
    return memory;
}

/* Copies an array (rows, columns) into blocks of columns one after the other, the last one padded with zeros.
 * With a block as wide as the padded columns the rows stay whole. */
static float *load(PyObject *array, int rows, int columns, int block, const char *name)
{
    Py_buffer buffer;
    if (!view(array, "f", (Py_ssize_t)rows * columns, name, &buffer))
        return NULL;
    float *blocks = zeros((size_t)rows * ((columns + block - 1) / block * block));
    for (int row = 0; blocks != NULL && row < rows; row++)
        for (int j = 0; j < columns; j++)
            blocks[((size_t)(j / block) * rows + row) * block + j % block] =
                ((float *)buffer.buf)[(size_t)row * columns + j];
    PyBuffer_Release(&buffer);
    return blocks;
}

static bool set_widths(Network *net, PyObject *widths)
{
    net->layers = (int)PyTuple_GET_SIZE(widths);
    if (net->layers < 1 || net->layers > MAX_LAYERS) {
        PyErr_Format(PyExc_ValueError, "the kernel takes 1 to %d hidden layers, got %d", MAX_LAYERS,
                     net->layers);
        return false;
    }
    for (int l = 0; l < net->layers; l++) {
        Layer *layer = &net->layer[l];
        const int block = net->engine->block;
        layer->width = (int)PyLong_AsLong(PyTuple_GET_ITEM(widths, l));
        layer->padded = (layer->width + block - 1) / block * block;
        net->stride = layer->padded > net->stride ? layer->padded : net->stride;
    }
    return !PyErr_Occurred();
}

static const Engine *find_engine(const char *name)
{
    for (const Engine *const *engine = engines(); *engine != NULL; engine++)
        if (strcmp((*engine)->name, name) == 0)
            return *engine;
    PyErr_Format(PyExc_ValueError, "this processor has no engine %s", name);
    return NULL;
}

static bool load_schedule(Network *net, PyObject *array)
{
    Py_buffer buffer;
    _Static_assert(sizeof(FlowStep) == 5 * sizeof(double), "a step is five numbers");
    if (!view(array, "d", (Py_ssize_t)net->steps * 5, "schedule", &buffer))
        return false;
    net->schedule = malloc(buffer.len);
    if (net->schedule == NULL)
        PyErr_NoMemory();
    else
        memcpy(net->schedule, buffer.buf, buffer.len);
    PyBuffer_Release(&buffer);
    return net->schedule != NULL;
}

static bool load_weights(Network *net, PyObject *arrays)
{
    PyObject *action, *observation, *time_parts, *prior_gain, *schedule;
    PyObject *matrices, *biases, *output, *output_bias;
    if (!PyArg_ParseTuple(arrays, "OOOOOO!O!OO", &action, &observation, &time_parts, &prior_gain, &schedule,
                          &PyTuple_Type, &matrices, &PyTuple_Type, &biases, &output, &output_bias))
        return false;
    if (PyTuple_GET_SIZE(matrices) != net->layers - 1 || PyTuple_GET_SIZE(biases) != net->layers - 1) {
        PyErr_SetString(PyExc_ValueError, "every hidden layer but the first needs a matrix and a bias");
        return false;
    }
    const int d = net->action_dim, block = net->engine->block;
    Layer *first = &net->layer[0], *last = &net->layer[net->layers - 1];
    first->matrix = load(observation, net->observation_dim, first->width, first->padded, "observation");
    net->action_rows = load(action, d, first->width, first->padded, "action");
    net->time_parts = load(time_parts, net->steps, first->width, first->padded, "time_parts");
    net->prior_gain = load(prior_gain, 1, net->steps, net->steps, "prior_gain");
    if (!load_schedule(net, schedule))
        return false;
    for (Layer *layer = first + 1; layer <= last && !PyErr_Occurred(); layer++) {
        const Py_ssize_t index = layer - first - 1;
        layer->matrix =
            load(PyTuple_GET_ITEM(matrices, index), layer[-1].width, layer->width, block, "a matrix");
        layer->bias = load(PyTuple_GET_ITEM(biases, index), 1, layer->width, layer->padded, "a bias");
    }
    net->output = load(output, d, last->width, last->padded, "output");
    net->output_bias = load(output_bias, 1, d, d, "output_bias");
    return !PyErr_Occurred();
}

static bool allocate_buffers(Network *net)
{
    const size_t rows = (size_t)net->batch * (1 + net->action_dim);
    net->observed = zeros((size_t)net->batch * net->layer[0].padded);
    net->before = zeros(rows * net->stride);
    net->after = zeros(rows * net->stride);
    return !PyErr_Occurred();
}

static bool view_ends(NetworkObject *self, PyObject *action, PyObject *result)
{
    const Py_ssize_t count = (Py_ssize_t)self->net.batch * self->net.action_dim;
    if (!view(action, "f", count, "action", &self->action) ||
        !view(result, "f", count * (1 + self->net.action_dim), "result", &self->result))
        return false;
    if (self->result.readonly)
        PyErr_SetString(PyExc_ValueError, "result must be writable");
    return !self->result.readonly;
}

static void network_dealloc(NetworkObject *self)
{
    Network *net = &self->net;
    PyBuffer_Release(&self->action);
    PyBuffer_Release(&self->result);
    for (int l = 0; l < net->layers; l++) {
        free(net->layer[l].matrix);
        free(net->layer[l].bias);
    }
    free(net->action_rows);
    free(net->time_parts);
    free(net->prior_gain);
    free(net->schedule);
    free(net->output);
    free(net->output_bias);
    free(net->observed);
    free(net->before);
    free(net->after);
    free(self->scratch);
    Py_TYPE(self)->tp_free((PyObject *)self);
}

static PyObject *network_new(PyTypeObject *type, PyObject *arguments, PyObject *Py_UNUSED(keywords))
{
    const char *engine;
    PyObject *widths, *arrays, *action, *result;
    Network net = {0};
    if (!PyArg_ParseTuple(arguments, "sp(iiii)O!O!OO", &engine, &net.silu, &net.action_dim,
                          &net.observation_dim, &net.steps, &net.batch, &PyTuple_Type, &widths,
                          &PyTuple_Type, &arrays, &action, &result))
        return NULL;
    net.engine = find_engine(engine);
    if (net.engine == NULL)
        return NULL;
    NetworkObject *self = (NetworkObject *)type->tp_alloc(type, 0);
    if (self == NULL)
        return NULL;
    self->net = net;
    if (set_widths(&self->net, widths) && load_weights(&self->net, arrays) && allocate_buffers(&self->net) &&
        view_ends(self, action, result))
        return (PyObject *)self;
    Py_DECREF(self);
    return NULL;
}

static PyObject *network_observe(NetworkObject *self, PyObject *observation)
{
    Network *net = &self->net;
    Py_buffer buffer;
    if (!view(observation, "f", (Py_ssize_t)net->batch * net->observation_dim, "observation", &buffer))
        return NULL;
    net->engine->observe(net, buffer.buf);
    PyBuffer_Release(&buffer);
    Py_RETURN_NONE;
}

static PyObject *take_step(NetworkObject *self, PyObject *number, int tangents)
{
    Network *net = &self->net;
    const long k = PyLong_AsLong(number);
    if (k == -1 && PyErr_Occurred())
        return NULL;
    if (k < 0 || k >= net->steps)
        return PyErr_Format(PyExc_IndexError, "step %ld of %d", k, net->steps);
    net->engine->step(net, (int)k, tangents, self->action.buf, self->result.buf);
    Py_RETURN_NONE;
}

static PyObject *network_step(NetworkObject *self, PyObject *number)
{
    return take_step(self, number, self->net.action_dim);
}

static PyObject *network_velocity(NetworkObject *self, PyObject *number) { return take_step(self, number, 0); }

/* Reads an action (d,) from a tuple; false with an exception set if it is none. */
static bool read_action(PyObject *numbers, int action_dim, Vector *action)
{
    if (!PyTuple_Check(numbers) || PyTuple_GET_SIZE(numbers) != action_dim) {
        PyErr_Format(PyExc_ValueError, "start must be a tuple of %d numbers", action_dim);
        return false;
    }
    for (int i = 0; i < action_dim; i++)
        action->at[i] = PyFloat_AsDouble(PyTuple_GET_ITEM(numbers, i));
    return !PyErr_Occurred();
}

/* Memory for terms, points and samples of so many robots; false with an exception set if there is none. */
static bool lay_out(NetworkObject *self, size_t terms, size_t points, Flight *flight, Point **first)
{
    const size_t samples = sizeof(Sample) * flight->robots, size = samples + sizeof(Term) * terms;
    const size_t needed = size + sizeof(Point) * points;
    if (needed > self->scratch_size) {
        free(self->scratch);
        self->scratch = malloc(needed);
        self->scratch_size = self->scratch == NULL ? 0 : needed;
    }
    if (self->scratch == NULL) {
        PyErr_NoMemory();
        return false;
    }
    flight->samples = self->scratch;
    flight->terms = (Term *)((char *)self->scratch + samples);
    *first = (Point *)((char *)self->scratch + size);
    return true;
}

/* Reads what each robot sees, (robots, size of a view), into terms; samples are all at their start. */
static bool look(NetworkObject *self, const Sight *sight, PyObject *views, Flight *flight)
{
    const Steering *steering = flight->steering;
    const int d = self->net.action_dim, dims = steering->dims, count = steering->count;
    const Py_ssize_t size = view_size(d, dims, sight);
    const size_t most = (size_t)most_points(sight);
    Point *points;
    Py_buffer buffer;
    if (!view(views, "d", size * flight->robots, "views", &buffer))
        return false;
    const size_t terms = (size_t)flight->robots * count;
    const bool enough = lay_out(self, terms, terms * most, flight, &points);
    for (size_t t = 0; enough && t < terms; t++)
        flight->terms[t] = outlook(&steering->objectives[t % count], d, dims, sight,
                                   (double *)buffer.buf + (Py_ssize_t)(t / count) * size, points + t * most);
    for (int b = 0; enough && b < flight->robots; b++)
        flight->samples[b] = (Sample){.fault = -1, .reach = ((double *)buffer.buf)[(b + 1) * size - 1]};
    PyBuffer_Release(&buffer);
    return enough;
}

/* Reads how to steer; false with an exception set where that does not hold together. */
static bool read_program(NetworkObject *self, PyObject *program, const Sight *sight, Py_buffer *buffer,
                         Steering *steering)
{
    if (self->net.action_dim > MAX_ACTION || sight->mates < 0 || sight->obstacles < 0 || sight->tracked < 0) {
        PyErr_Format(PyExc_ValueError, "sample takes up to %d action components, and counts from 0 on",
                     MAX_ACTION);
        return false;
    }
    if (PyObject_GetBuffer(program, buffer, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) < 0)
        return false;
    int read = -1;
    if (strcmp(buffer->format, "d") == 0)
        read = read_steering(buffer->buf, buffer->len / (Py_ssize_t)sizeof(double), self->net.action_dim,
                             steering);
    if (read >= 0 && read == steering->count)
        return true;
    if (read < 0)
        PyErr_SetString(PyExc_ValueError, "the program has no head");
    else
        PyErr_Format(PyExc_ValueError, "objective %d does not hold what its kind takes", read);
    PyBuffer_Release(buffer);
    return false;
}

/* Samples all robots whose starts stand in the samples; false with an exception set if Python raised. */
static bool fly(NetworkObject *self, Flight *flight, double left_s, int most_steps)
{
    if (self->sampling) {
        PyErr_SetString(PyExc_ValueError, "an objective samples the policy that it guides");
        return false;
    }
    self->sampling = true;
    flight->actions = self->action.buf;
    flight->result = self->result.buf;
    sample_guided(&self->net, flight, left_s, most_steps);
    self->sampling = false;
    return !PyErr_Occurred();
}

static PyObject *sample_tuple(const Sample *sample, int d, int count)
{
    PyObject *conflicts = PyTuple_New(count);
    for (int m = 0; conflicts != NULL && m < count; m++)
        PyTuple_SET_ITEM(conflicts, m, PyLong_FromLong(sample->conflicts[m]));
    return Py_BuildValue("NiiiiNNNN", tuple_of(sample->action.at, d), sample->steps, sample->projections,
                         sample->fault, sample->opposed, tuple_of(sample->costs, count), conflicts,
                         tuple_of(sample->correction.at, d), PyBool_FromLong(sample->cut));
}

static PyObject *network_sample(NetworkObject *self, PyObject *arguments)
{
    PyObject *program, *views, *start, *own, *sampled = NULL;
    Py_buffer buffer;
    Steering steering;
    Flight flight = {.steering = &steering, .robots = 1};
    Sight sight;
    Vector action;
    int most_steps;
    double left_s;
    if (!PyArg_ParseTuple(arguments, "O(iii)OOdiO", &program, &sight.mates, &sight.obstacles, &sight.tracked,
                          &views, &start, &left_s, &most_steps, &own))
        return NULL;
    if (self->net.batch != 1)
        return PyErr_Format(PyExc_ValueError, "sample takes one robot, sample_batch all of a batch");
    if (!read_action(start, self->net.action_dim, &action) ||
        !read_program(self, program, &sight, &buffer, &steering))
        return NULL;
    flight.own = own;
    if (look(self, &sight, views, &flight)) {
        flight.samples->action = action;
        if (fly(self, &flight, left_s, most_steps))
            sampled = sample_tuple(flight.samples, self->net.action_dim, steering.count);
    }
    PyBuffer_Release(&buffer);
    return sampled;
}

/* Whether all that steers is computed here. */
static bool needs_no_python(const Steering *steering)
{
    for (int m = 0; m < steering->count; m++)
        if (steering->objectives[m].kind == PYTHON)
            return false;
    return true;
}

/* From the starts in `actions` (B, d) to the samples there; NaN where something was not finite. */
static bool sample_all(NetworkObject *self, Flight *flight, double *actions)
{
    const int d = self->net.action_dim;
    for (int b = 0; b < flight->robots; b++)
        memcpy(flight->samples[b].action.at, actions + (size_t)b * d, sizeof(double) * d);
    if (!fly(self, flight, INFINITY, self->net.steps))
        return false;
    for (int b = 0; b < flight->robots; b++)
        for (int i = 0; i < d; i++)
            actions[(size_t)b * d + i] =
                flight->samples[b].fault < 0 ? flight->samples[b].action.at[i] : NAN;
    return true;
}

static PyObject *network_sample_batch(NetworkObject *self, PyObject *arguments)
{
    PyObject *program, *views, *actions;
    Py_buffer buffer, starts;
    Steering steering;
    Flight flight = {.steering = &steering, .robots = self->net.batch};
    Sight sight;
    if (!PyArg_ParseTuple(arguments, "O(iii)OO", &program, &sight.mates, &sight.obstacles, &sight.tracked,
                          &views, &actions) ||
        !read_program(self, program, &sight, &buffer, &steering))
        return NULL;
    bool done = false;
    if (!needs_no_python(&steering))
        PyErr_SetString(PyExc_ValueError, "objectives in Python steer one robot, no batch");
    else if (view(actions, "d", (Py_ssize_t)flight.robots * self->net.action_dim, "actions", &starts)) {
        if (starts.readonly)
            PyErr_SetString(PyExc_ValueError, "actions must be writable");
        else
            done = look(self, &sight, views, &flight) && sample_all(self, &flight, starts.buf);
        PyBuffer_Release(&starts);
    }
    PyBuffer_Release(&buffer);
    if (!done)
        return NULL;
    Py_RETURN_NONE;
}

static PyMethodDef network_methods[] = {
    {"observe", (PyCFunction)network_observe, METH_O, "observe(observation): float32 (B, O)"},
    {"step", (PyCFunction)network_step, METH_O, "step(k): reads action (B, d), writes result (B, 1 + d, d)"},
    {"velocity", (PyCFunction)network_velocity, METH_O, "velocity(k): as step, of result the first B d alone"},
    {"sample", (PyCFunction)network_sample, METH_VARARGS,
     "sample(program, (mates, obstacles, tracked), views, start, left_s, most_steps, own) -> (action, steps, "
     "projections, fault, opposed, costs, conflicts, correction, cut)"},
    {"sample_batch", (PyCFunction)network_sample_batch, METH_VARARGS,
     "sample_batch(program, (mates, obstacles, tracked), views, actions): actions (B, d) from start to sample"},
    {0}};

static PyTypeObject network_type = {
    PyVarObject_HEAD_INIT(NULL, 0).tp_name = "edge_runtime.policy._kernel.Network",
    .tp_basicsize = sizeof(NetworkObject),
    .tp_dealloc = (destructor)network_dealloc,
    .tp_flags = Py_TPFLAGS_DEFAULT,
    .tp_doc = "Network(engine, silu, (d, O, T, B), widths, arrays, action, result); compiled_policy.py says "
              "which arrays.",
    .tp_methods = network_methods,
    .tp_new = network_new,
};

static PyObject *list_engines(PyObject *Py_UNUSED(module), PyObject *Py_UNUSED(nothing))
{
    PyObject *names = PyList_New(0);
    for (const Engine *const *engine = engines(); names != NULL && *engine != NULL; engine++) {
        PyObject *name = PyUnicode_FromString((*engine)->name);
        if (name == NULL || PyList_Append(names, name) < 0)
            Py_CLEAR(names);
        Py_XDECREF(name);
    }
    return names;
}

static PyMethodDef module_methods[] = {
    {"engines", list_engines, METH_NOARGS, "Instruction sets that this processor can run, fastest first."},
    {0}};

static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, .m_name = "_kernel", .m_size = -1,
                                    .m_methods = module_methods};

static const char *kind_name(int number) { return kinds[number].name; }
static const char *projection_name(int number) { return projection_names[number]; }

/* Adds a tuple of names, each at its number. */
static bool add_names(PyObject *module, const char *name, const char *(*name_of)(int), int count)
{
    PyObject *names = PyTuple_New(count);
    for (int number = 0; names != NULL && number < count; number++) {
        PyObject *text = PyUnicode_FromString(name_of(number));
        if (text == NULL)
            Py_CLEAR(names);
        else
            PyTuple_SET_ITEM(names, number, text);
    }
    const bool added = names != NULL && PyModule_AddObjectRef(module, name, names) == 0;
    Py_XDECREF(names);
    return added;
}

PyMODINIT_FUNC PyInit__kernel(void)
{
    PyObject *self = PyModule_Create(&module);
    if (self == NULL || PyType_Ready(&network_type) < 0)
        return NULL;
    if (PyModule_AddObjectRef(self, "Network", (PyObject *)&network_type) < 0 ||
        !add_names(self, "TERMS", kind_name, KINDS) ||
        !add_names(self, "PROJECTIONS", projection_name, PROJECTIONS) ||
        PyModule_AddIntMacro(self, INTERFACE) < 0 || PyModule_AddIntMacro(self, MAX_TERMS) < 0 ||
        PyModule_AddIntMacro(self, MAX_ACTION) < 0 || PyModule_AddIntMacro(self, MAX_LAYERS) < 0)
        Py_CLEAR(self);
    return self;
}
