/* Python face of filter_host.h: checks buffers, releases the GIL, translates the status. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <string.h>

#include "filter_host.h"

#define MAX_ARRAYS 16

/* One array of a call: its buffer, its name for messages, whether it is written. */
typedef struct {
    Py_buffer view;
    const char *name;
    int held, writable;
} array;

typedef struct {
    array item[MAX_ARRAYS];
    int n;
} arrays;

static int fits(const Py_buffer *view, const char *format, size_t itemsize)
{
    const char *const found = view->format == NULL ? "" : view->format;
    return view->itemsize == (Py_ssize_t)itemsize && (size_t)view->buf % itemsize == 0 &&
           (strcmp(found, format) == 0 || (found[0] == '@' && strcmp(found + 1, format) == 0));
}

/* A C-contiguous, aligned buffer of native float64 (uint8); None is an array that is not there. */
static array *take(arrays *all, PyObject *object, const char *name, int writable, int bytes)
{
    array *const a = &all->item[all->n++];
    *a = (array){.name = name, .writable = writable};
    if (object == Py_None)
        return a;
    const int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0);
    if (PyObject_GetBuffer(object, &a->view, flags) != 0)
        return NULL;
    a->held = 1;
    if (fits(&a->view, bytes ? "B" : "d", bytes ? 1 : sizeof(double)))
        return a;
    PyErr_Format(PyExc_ValueError, "%s: needed a contiguous, aligned %s array", name,
                 bytes ? "uint8" : "float64");
    return NULL;
}

static void release(arrays *all)
{
    for (int i = 0; i < all->n; ++i)
        if (all->item[i].held)
            PyBuffer_Release(&all->item[i].view);
}

static size_t length(const array *a) { return (size_t)(a->view.len / a->view.itemsize); }

static int has_length(const array *a, size_t needed, int optional)
{
    if (optional && !a->held)
        return 1;
    if (a->held && length(a) == needed)
        return 1;
    PyErr_Format(PyExc_ValueError, "%s: found %zd values, needed %zd", a->name,
                 a->held ? (Py_ssize_t)length(a) : (Py_ssize_t)0, (Py_ssize_t)needed);
    return 0;
}

/* No array that is written may share memory with another one. */
static int apart(const arrays *all)
{
    for (int i = 0; i < all->n; ++i) {
        const array *const a = &all->item[i];
        for (int j = 0; a->writable && a->held && j < all->n; ++j) {
            const array *const b = &all->item[j];
            if (i == j || !b->held || a->view.len == 0 || b->view.len == 0)
                continue;
            if ((size_t)a->view.buf < (size_t)b->view.buf + (size_t)b->view.len &&
                (size_t)b->view.buf < (size_t)a->view.buf + (size_t)a->view.len) {
                PyErr_Format(PyExc_ValueError, "%s and %s share memory", a->name, b->name);
                return 0;
            }
        }
    }
    return 1;
}

static double *numbers(const array *a) { return a->held ? a->view.buf : NULL; }

static int read_model(hdb_model *model, const array *a)
{
    if (a->held && hdb_model_read(model, a->view.buf, length(a)) == HDB_OK)
        return 1;
    PyErr_SetString(PyExc_ValueError, "a number of the model is out of its domain");
    return 0;
}

/* Take the members of a tuple one by one. */
static int take_tuple(arrays *all, PyObject *tuple, const char *const *names, int n, int writable)
{
    if (!PyTuple_Check(tuple) || PyTuple_Size(tuple) != n) {
        PyErr_Format(PyExc_TypeError, "needed a tuple of %d arrays, %s first", n, names[0]);
        return 0;
    }
    for (int i = 0; i < n; ++i)
        if (take(all, PyTuple_GetItem(tuple, i), names[i], writable, 0) == NULL)
            return 0;
    return 1;
}

static PyObject *answer(hdb_status status, size_t bad)
{
    if (status == HDB_ERR_CONFIG) {
        PyErr_SetString(PyExc_ValueError, "a number of the model is out of its domain");
        return NULL;
    }
    return status == HDB_OK ? PyLong_FromLong(-1) : PyLong_FromSize_t(bad);
}

static const char *const SAMPLES[] = {"time_s", "velocity_rad_s", "torque_nm", "angle_rad"};
enum { TIME, VELOCITY, TORQUE, ANGLE, N_SAMPLES };

static hdb_samples samples_of(const array *a)
{
    return (hdb_samples){numbers(a + TIME), numbers(a + VELOCITY), numbers(a + TORQUE),
                         numbers(a + ANGLE)};
}

static int sample_lengths(const array *a, size_t n, size_t n_values)
{
    return has_length(a + TIME, n, 0) && has_length(a + VELOCITY, n_values, 0) &&
           has_length(a + TORQUE, n_values, 0) && has_length(a + ANGLE, n_values, 1);
}

static const char *const OUTPUTS[] = {"torque_expected_nm", "ripple_nm", "misalignment_nm",
                                      "slow_nm", "torque_filtered_nm", "innovation_nm",
                                      "innovation_variance_nm2"};
enum { N_OUTPUTS = 7 };

static PyObject *run_taken(arrays *all)
{
    const array *const a = all->item, *const in = a + 2, *const out = in + N_SAMPLES;
    const array *const flags = out + N_OUTPUTS, *const sums = flags + 1;
    hdb_model model;
    if (!read_model(&model, &a[0]))
        return NULL;
    const size_t n = in->held ? length(in) : 0;
    const size_t nb = (size_t)(model.n_oscillators + model.n_slow);
    int good = has_length(&a[1], HDB_STATE_SIZE(nb), 0) && sample_lengths(in, n, n) &&
               has_length(flags, n, 0) && has_length(sums, 3, 0);
    for (int i = 0; i < N_OUTPUTS; ++i)
        good = good && has_length(out + i, n, 0);
    if (!good || !apart(all))
        return NULL;
    const hdb_samples samples = samples_of(in);
    const hdb_outputs outputs = {
        numbers(out), numbers(out + 1), numbers(out + 2), numbers(out + 3), numbers(out + 4),
        numbers(out + 5), numbers(out + 6), flags->view.buf};
    size_t bad = 0;
    hdb_status status;
    Py_BEGIN_ALLOW_THREADS
    status = hdb_filter_run(&model, a[1].view.buf, n, &samples, &outputs, sums->view.buf, &bad);
    Py_END_ALLOW_THREADS
    return answer(status, bad);
}

static PyObject *run(PyObject *module, PyObject *args)
{
    PyObject *model, *state, *samples, *outputs, *flags, *sums, *result = NULL;
    arrays all = {.n = 0};
    (void)module;
    if (!PyArg_UnpackTuple(args, "run", 6, 6, &model, &state, &samples, &outputs, &flags, &sums))
        return NULL;
    if (take(&all, model, "model", 0, 0) != NULL && take(&all, state, "state", 1, 0) != NULL &&
        take_tuple(&all, samples, SAMPLES, N_SAMPLES, 0) &&
        take_tuple(&all, outputs, OUTPUTS, N_OUTPUTS, 1) &&
        take(&all, flags, "flags", 1, 1) != NULL && take(&all, sums, "sums", 1, 0) != NULL)
        result = run_taken(&all);
    release(&all);
    return result;
}

static PyObject *batch_taken(arrays *all)
{
    const array *const a = all->item, *const in = a + 1, *const out = in + N_SAMPLES;
    hdb_model model;
    if (!read_model(&model, &a[0]))
        return NULL;
    const size_t n = in->held ? length(in) : 0;
    const size_t traces = out[3].held ? length(out + 3) / 3 : 0, values = n * traces;
    if (!sample_lengths(in, n, values) || !has_length(out, values, 0) ||
        !has_length(out + 1, values, 1) || !has_length(out + 2, values, !out[1].held) ||
        !has_length(out + 3, 3 * traces, 0) || !apart(all))
        return NULL;
    const hdb_samples samples = samples_of(in);
    const hdb_outputs outputs = {.filtered = numbers(out), .innovation = numbers(out + 1),
                                 .variance = numbers(out + 2)};
    size_t bad = 0;
    hdb_status status;
    Py_BEGIN_ALLOW_THREADS
    status = hdb_filter_batch(&model, n, traces, &samples, &outputs, out[3].view.buf, &bad);
    Py_END_ALLOW_THREADS
    return answer(status, bad);
}

static PyObject *batch(PyObject *module, PyObject *args)
{
    static const char *const names[] = {"torque_filtered_nm", "innovation_nm",
                                        "innovation_variance_nm2"};
    PyObject *model, *samples, *outputs, *sums, *result = NULL;
    arrays all = {.n = 0};
    (void)module;
    if (!PyArg_UnpackTuple(args, "batch", 4, 4, &model, &samples, &outputs, &sums))
        return NULL;
    if (take(&all, model, "model", 0, 0) != NULL &&
        take_tuple(&all, samples, SAMPLES, N_SAMPLES, 0) &&
        take_tuple(&all, outputs, names, 3, 1) && take(&all, sums, "sums", 1, 0) != NULL)
        result = batch_taken(&all);
    release(&all);
    return result;
}

static PyObject *smooth_taken(arrays *all)
{
    const array *const a = all->item, *const in = a + 1, *const out = in + N_SAMPLES;
    hdb_model model;
    if (!read_model(&model, &a[0]))
        return NULL;
    const size_t n = in->held ? length(in) : 0;
    const size_t nb = (size_t)(model.n_oscillators + model.n_slow);
    if (!sample_lengths(in, n, n) || !has_length(out, n, 0) ||
        !has_length(out + 1, 2 * nb * n, 0) || !has_length(out + 2, 3 * nb * n, 1) || !apart(all))
        return NULL;
    double *const scratch = PyMem_Malloc(hdb_smooth_scratch(&model, n) * sizeof(double));
    if (scratch == NULL)
        return PyErr_NoMemory();
    const hdb_samples samples = samples_of(in);
    size_t bad = 0;
    hdb_status status;
    Py_BEGIN_ALLOW_THREADS
    status = hdb_filter_smooth(&model, n, &samples, numbers(out), numbers(out + 1),
                               numbers(out + 2), scratch, &bad);
    Py_END_ALLOW_THREADS
    PyMem_Free(scratch);
    return answer(status, bad);
}

static PyObject *smooth(PyObject *module, PyObject *args)
{
    PyObject *model, *samples, *expected, *mean, *covariance, *result = NULL;
    arrays all = {.n = 0};
    (void)module;
    if (!PyArg_UnpackTuple(args, "smooth", 5, 5, &model, &samples, &expected, &mean, &covariance))
        return NULL;
    if (take(&all, model, "model", 0, 0) != NULL &&
        take_tuple(&all, samples, SAMPLES, N_SAMPLES, 0) &&
        take(&all, expected, "torque_expected_nm", 1, 0) != NULL &&
        take(&all, mean, "mean", 1, 0) != NULL &&
        take(&all, covariance, "covariance", 1, 0) != NULL)
        result = smooth_taken(&all);
    release(&all);
    return result;
}

PyDoc_STRVAR(run_doc, "Filter samples; arguments and result as hdbench.filter.fallback.run.");
PyDoc_STRVAR(batch_doc, "Filter many traces; as hdbench.filter.fallback.batch.");
PyDoc_STRVAR(smooth_doc, "Smooth a trace; as hdbench.filter.fallback.smooth.");

static PyMethodDef methods[] = {{"run", run, METH_VARARGS, run_doc},
                                {"batch", batch, METH_VARARGS, batch_doc},
                                {"smooth", smooth, METH_VARARGS, smooth_doc},
                                {NULL, NULL, 0, NULL}};

static PyModuleDef_Slot slots[] = {{0, NULL}};

static struct PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT,
    .m_name = "hdbench.filter._kernel",
    .m_doc = "Compiled form of the filter.",
    .m_size = 0,
    .m_methods = methods,
    .m_slots = slots,
};

PyMODINIT_FUNC PyInit__kernel(void);
PyMODINIT_FUNC PyInit__kernel(void) { return PyModuleDef_Init(&definition); }
