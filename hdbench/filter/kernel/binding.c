/* Python face of oscillator.h: checks buffers, releases the GIL, translates the status. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <string.h>

#include "oscillator.h"

enum { ORDER, NOISE, ROLE, PARAMETERS, STATE, TIME, VELOCITY, TORQUE, ANGLE, EXPECTED, RIPPLE,
       MISALIGNED, FILTERED, N_ARRAYS };

static const char *const NAMES[N_ARRAYS] = {
    "order", "process_noise", "misalignment", "parameters", "state", "time_s", "velocity_rad_s",
    "torque_nm", "angle_rad", "torque_expected_nm", "ripple_nm", "misalignment_nm",
    "torque_filtered_nm"};

static int is_output(int i) { return i == STATE || i >= EXPECTED; }

/* A C-contiguous, one-dimensional, aligned buffer of native float64. */
static int take(PyObject *object, int i, Py_buffer *view)
{
    const int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (is_output(i) ? PyBUF_WRITABLE : 0);
    if (PyObject_GetBuffer(object, view, flags) != 0)
        return -1;
    if (view->ndim != 1 || view->itemsize != (Py_ssize_t)sizeof(double) || view->format == NULL ||
        (strcmp(view->format, "d") != 0 && strcmp(view->format, "@d") != 0) ||
        (size_t)view->buf % sizeof(double) != 0) {
        PyBuffer_Release(view);
        PyErr_Format(PyExc_ValueError,
                     "%s: needed a contiguous, aligned, one-dimensional float64 array", NAMES[i]);
        return -1;
    }
    return 0;
}

static int has_length(const Py_buffer *view, int i, size_t needed)
{
    const size_t found = (size_t)view->len / sizeof(double);
    if (found == needed)
        return 1;
    PyErr_Format(PyExc_ValueError, "%s: found %zd values, needed %zd", NAMES[i], (Py_ssize_t)found,
                 (Py_ssize_t)needed);
    return 0;
}

static int check_lengths(const Py_buffer *view, int with_angle)
{
    const size_t nb = (size_t)view[ORDER].len / sizeof(double);
    const size_t n = (size_t)view[TIME].len / sizeof(double);
    if (nb < 1 || nb > HDB_MAX_BLOCKS) {
        PyErr_Format(PyExc_ValueError, "order: found %zd blocks, needed 1 to %d", (Py_ssize_t)nb,
                     HDB_MAX_BLOCKS);
        return 0;
    }
    if (!has_length(&view[NOISE], NOISE, nb) || !has_length(&view[ROLE], ROLE, nb) ||
        !has_length(&view[PARAMETERS], PARAMETERS, 4) ||
        !has_length(&view[STATE], STATE, hdb_state_size(nb)))
        return 0;
    for (int i = VELOCITY; i < N_ARRAYS; ++i)
        if ((i != ANGLE || with_angle) && !has_length(&view[i], i, n))
            return 0;
    return 1;
}

/* No array that is written may share memory with another one. */
static int check_overlap(const Py_buffer *view, int with_angle)
{
    for (int i = 0; i < N_ARRAYS; ++i) {
        if (!is_output(i))
            continue;
        const char *const a = view[i].buf;
        for (int j = 0; j < N_ARRAYS; ++j) {
            if (i == j || (j == ANGLE && !with_angle) || view[i].len == 0 || view[j].len == 0)
                continue;
            const char *const b = view[j].buf;
            if ((size_t)a < (size_t)b + (size_t)view[j].len &&
                (size_t)b < (size_t)a + (size_t)view[i].len) {
                PyErr_Format(PyExc_ValueError, "%s and %s share memory", NAMES[i], NAMES[j]);
                return 0;
            }
        }
    }
    return 1;
}

static PyObject *filter(const Py_buffer *view, int with_angle)
{
    const double *const parameters = view[PARAMETERS].buf;
    const hdb_config config = {
        .n_blocks = (size_t)view[ORDER].len / sizeof(double),
        .order = view[ORDER].buf,
        .process_noise = view[NOISE].buf,
        .misalignment = view[ROLE].buf,
        .measurement_noise = parameters[0],
        .load_inertia = parameters[1],
        .gear_ratio = parameters[2],
        .differentiator_time_constant = parameters[3],
    };
    size_t bad = 0;
    hdb_status status;
    Py_BEGIN_ALLOW_THREADS
    status = hdb_filter_run(&config, view[STATE].buf, (size_t)view[TIME].len / sizeof(double),
                            view[TIME].buf, view[VELOCITY].buf, view[TORQUE].buf,
                            with_angle ? view[ANGLE].buf : NULL, view[EXPECTED].buf,
                            view[RIPPLE].buf, view[MISALIGNED].buf, view[FILTERED].buf, &bad);
    Py_END_ALLOW_THREADS
    switch (status) {
    case HDB_OK: return PyLong_FromLong(-1);
    case HDB_ERR_TIME: return PyLong_FromSize_t(bad);
    case HDB_ERR_CONFIG: break;
    }
    PyErr_SetString(PyExc_ValueError,
                    "order, noise, gear ratio and time constant must be positive and finite, "
                    "inertia at least 0, roles 0 or 1");
    return NULL;
}

static PyObject *run(PyObject *module, PyObject *args)
{
    Py_buffer view[N_ARRAYS];
    PyObject *object[N_ARRAYS], *result = NULL;
    int taken[N_ARRAYS] = {0}, i;
    (void)module;
    if (!PyArg_UnpackTuple(args, "run", N_ARRAYS, N_ARRAYS, &object[0], &object[1], &object[2],
                           &object[3], &object[4], &object[5], &object[6], &object[7], &object[8],
                           &object[9], &object[10], &object[11], &object[12]))
        return NULL;
    const int with_angle = object[ANGLE] != Py_None;
    for (i = 0; i < N_ARRAYS; ++i) {
        if (i == ANGLE && !with_angle)
            continue;
        if (take(object[i], i, &view[i]) != 0)
            goto done;
        taken[i] = 1;
    }
    if (check_lengths(view, with_angle) && check_overlap(view, with_angle))
        result = filter(view, with_angle);
done:
    for (i = 0; i < N_ARRAYS; ++i)
        if (taken[i])
            PyBuffer_Release(&view[i]);
    return result;
}

PyDoc_STRVAR(run_doc, "Filter samples; same arguments and result as hdbench.filter.recursion.run.");

static PyMethodDef methods[] = {{"run", run, METH_VARARGS, run_doc}, {NULL, NULL, 0, NULL}};

static PyModuleDef_Slot slots[] = {{0, NULL}};

static struct PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT,
    .m_name = "hdbench.filter._kernel",
    .m_doc = "Compiled form of the oscillator filter.",
    .m_size = 0,
    .m_methods = methods,
    .m_slots = slots,
};

PyMODINIT_FUNC PyInit__kernel(void);
PyMODINIT_FUNC PyInit__kernel(void) { return PyModuleDef_Init(&definition); }
