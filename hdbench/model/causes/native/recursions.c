/* Recursions over samples for causes that remember; hdbench/model/causes/_twins.py says the same
 * in Python. Complex numbers are pairs of float64. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "arrays.h"

#define TAKE(index, name, writable, bytes)                                                         \
    (take(&all, PyTuple_GetItem(args, index), name, writable, bytes) != NULL)

static int count_is(PyObject *args, Py_ssize_t n)
{
    if (PyTuple_Size(args) == n)
        return 1;
    PyErr_Format(PyExc_TypeError, "found %zd arguments, needed %zd", PyTuple_Size(args), n);
    return 0;
}

/* z[k] = decay[k] z[k-1] + drive[k], z[-1] = 0 */
static void run_first_order(size_t n, const double *decay, const double *drive, double *out)
{
    double z = 0.0;
    for (size_t k = 0; k < n; ++k)
        out[k] = z = decay[k] * z + drive[k];
}

static PyObject *first_order(PyObject *module, PyObject *args)
{
    arrays all = {.n = 0};
    PyObject *result = NULL;
    (void)module;
    if (!count_is(args, 3))
        return NULL;
    if (TAKE(0, "decay", 0, 0) && TAKE(1, "drive", 0, 0) && TAKE(2, "out", 1, 0)) {
        const array *const a = all.item;
        const size_t n = a[1].held ? length(&a[1]) : 0;
        if (has_length(&a[0], n, 0) && has_length(&a[2], n, 0) && apart(&all)) {
            Py_BEGIN_ALLOW_THREADS
            run_first_order(n, numbers(&a[0]), numbers(&a[1]), numbers(&a[2]));
            Py_END_ALLOW_THREADS
            result = Py_NewRef(Py_None);
        }
    }
    release(&all);
    return result;
}

/* A filter of second order in transposed direct form; a start is rest at its value. */
static void run_second_order(size_t n, const double *above, const double *below,
                             const unsigned char *starts, const double *x, double *out)
{
    const double b0 = above[0], b1 = above[1], b2 = above[2], a1 = below[0], a2 = below[1];
    const double gain = (b0 + b1 + b2) / (1.0 + a1 + a2);
    const double still2 = b2 - a2 * gain, still1 = b1 - a1 * gain + still2;
    double z1 = 0.0, z2 = 0.0;
    for (size_t k = 0; k < n; ++k) {
        const double in = x[k];
        if (starts[k]) {
            z1 = still1 * in;
            z2 = still2 * in;
        }
        const double y = b0 * in + z1;
        z1 = b1 * in - a1 * y + z2;
        z2 = b2 * in - a2 * y;
        out[k] = y;
    }
}

static PyObject *second_order(PyObject *module, PyObject *args)
{
    arrays all = {.n = 0};
    PyObject *result = NULL;
    (void)module;
    if (!count_is(args, 5))
        return NULL;
    if (TAKE(0, "above", 0, 0) && TAKE(1, "below", 0, 0) && TAKE(2, "starts", 0, 1) &&
        TAKE(3, "values", 0, 0) && TAKE(4, "out", 1, 0)) {
        const array *const a = all.item;
        const size_t n = a[3].held ? length(&a[3]) : 0;
        if (has_length(&a[0], 3, 0) && has_length(&a[1], 2, 0) && has_length(&a[2], n, 0) &&
            has_length(&a[4], n, 0) && apart(&all)) {
            Py_BEGIN_ALLOW_THREADS
            run_second_order(n, numbers(&a[0]), numbers(&a[1]), a[2].view.buf, numbers(&a[3]),
                             numbers(&a[4]));
            Py_END_ALLOW_THREADS
            result = Py_NewRef(Py_None);
        }
    }
    release(&all);
    return result;
}

/* Wave after both poles of a resonance, exact for a phase that is linear between samples. */
static void run_resonance(size_t n, const double *wave, const double *rate, const double *decays,
                          size_t stride, const unsigned char *starts, const double *pole,
                          double *out)
{
    const double pr = pole[0], pi = pole[1], scale = 0.5 * (pr * pr + pi * pi) / pi;
    double ur = 0.0, ui = 0.0, lr = 0.0, li = 0.0, br = n ? wave[0] : 0.0, bi = n ? wave[1] : 0.0;
    for (size_t k = 0; k < n; ++k) {
        const double wr = wave[2 * k], wi = wave[2 * k + 1];
        const double dr = starts[k] ? 0.0 : decays[stride * k];
        const double di = starts[k] ? 0.0 : decays[stride * k + 1];
        /* what drives each pole: (wave - decay before) / (i rate - pole) */
        const double fr = wr - (dr * br - di * bi), fi = wi - (dr * bi + di * br);
        const double gr = wr - (dr * br + di * bi), gi = wi - (dr * bi - di * br);
        const double up = rate[k] - pi, low = rate[k] + pi;
        const double over_up = 1.0 / (pr * pr + up * up), over_low = 1.0 / (pr * pr + low * low);
        const double ar = (up * fi - pr * fr) * over_up, ai = (-pr * fi - up * fr) * over_up;
        const double cr = (low * gi - pr * gr) * over_low, ci = (-pr * gi - low * gr) * over_low;
        const double nur = dr * ur - di * ui + ar, nlr = dr * lr + di * li + cr;
        ui = dr * ui + di * ur + ai;
        li = dr * li - di * lr + ci;
        ur = nur;
        lr = nlr;
        /* the difference over 2 i Im p */
        out[2 * k] = scale * (ui - li);
        out[2 * k + 1] = scale * (lr - ur);
        br = wr;
        bi = wi;
    }
}

static PyObject *resonance(PyObject *module, PyObject *args)
{
    arrays all = {.n = 0};
    PyObject *result = NULL;
    (void)module;
    if (!count_is(args, 6))
        return NULL;
    if (TAKE(0, "wave", 0, 0) && TAKE(1, "rate", 0, 0) && TAKE(2, "decay", 0, 0) &&
        TAKE(3, "starts", 0, 1) && TAKE(4, "pole", 0, 0) && TAKE(5, "out", 1, 0)) {
        const array *const a = all.item;
        const size_t n = a[1].held ? length(&a[1]) : 0;
        const int even = a[2].held && length(&a[2]) == 2;
        if (has_length(&a[0], 2 * n, 0) && has_length(&a[2], even ? 2 : 2 * n, 0) &&
            has_length(&a[3], n, 0) && has_length(&a[4], 2, 0) && has_length(&a[5], 2 * n, 0) &&
            apart(&all)) {
            Py_BEGIN_ALLOW_THREADS
            run_resonance(n, numbers(&a[0]), numbers(&a[1]), numbers(&a[2]), even ? 0 : 2,
                          a[3].view.buf, numbers(&a[4]), numbers(&a[5]));
            Py_END_ALLOW_THREADS
            result = Py_NewRef(Py_None);
        }
    }
    release(&all);
    return result;
}

/* Sum of play operators: each stays within its radius of the torque, moved no farther than needed;
 * at a start each is the torque. */
static void run_plays(size_t n, size_t m, const double *torque, const double *radius,
                      const unsigned char *starts, double *at, double *out)
{
    for (size_t k = 0; k < n; ++k) {
        const double x = torque[k];
        double sum = 0.0;
        for (size_t i = 0; i < m; ++i) {
            const double low = x - radius[i], high = x + radius[i];
            double p = starts[k] ? x : at[i];
            p = p < low ? low : p;
            p = p > high ? high : p;
            at[i] = p;
            sum += p;
        }
        out[k] = sum;
    }
}

static PyObject *plays(PyObject *module, PyObject *args)
{
    arrays all = {.n = 0};
    PyObject *result = NULL;
    (void)module;
    if (!count_is(args, 5))
        return NULL;
    if (TAKE(0, "torque", 0, 0) && TAKE(1, "radius", 0, 0) && TAKE(2, "starts", 0, 1) &&
        TAKE(3, "state", 1, 0) && TAKE(4, "out", 1, 0)) {
        const array *const a = all.item;
        const size_t n = a[0].held ? length(&a[0]) : 0, m = a[1].held ? length(&a[1]) : 0;
        if (has_length(&a[2], n, 0) && has_length(&a[3], m, 0) && has_length(&a[4], n, 0) &&
            apart(&all)) {
            Py_BEGIN_ALLOW_THREADS
            run_plays(n, m, numbers(&a[0]), numbers(&a[1]), a[2].view.buf, numbers(&a[3]),
                      numbers(&a[4]));
            Py_END_ALLOW_THREADS
            result = Py_NewRef(Py_None);
        }
    }
    release(&all);
    return result;
}

static PyMethodDef methods[] = {
    {"first_order", first_order, METH_VARARGS, "Run first_order of _twins."},
    {"second_order", second_order, METH_VARARGS, "Run second_order of _twins."},
    {"resonance", resonance, METH_VARARGS, "Run resonance of _twins."},
    {"plays", plays, METH_VARARGS, "Run plays of _twins."},
    {NULL, NULL, 0, NULL},
};

static PyModuleDef_Slot slots[] = {{0, NULL}};

static struct PyModuleDef definition = {
    .m_base = PyModuleDef_HEAD_INIT,
    .m_name = "hdbench.model.causes._recursions",
    .m_doc = "Compiled form of the recursions over samples.",
    .m_size = 0,
    .m_methods = methods,
    .m_slots = slots,
};

PyMODINIT_FUNC PyInit__recursions(void);
PyMODINIT_FUNC PyInit__recursions(void) { return PyModuleDef_Init(&definition); }
