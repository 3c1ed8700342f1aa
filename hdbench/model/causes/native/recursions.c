/* Recursions over samples for causes that remember; hdbench/model/causes/_twins.py says the same
 * in Python. Complex numbers are pairs of float64. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "arrays.h"

/* A recursion as Python calls it: its arrays, whether their lengths fit, and what it does. */
typedef struct {
    const char *names[6];
    int n, written, marks; /* arrays; the first one that is written; the one of uint8 */
    int (*fits)(const array *a);
    void (*run)(const array *a);
} recursion;

static size_t count(const array *a) { return a->held ? length(a) : 0; }

static const unsigned char *marks(const array *a) { return a->view.buf; }

/* z[k] = decay[k] z[k-1] + drive[k], z[-1] = 0 */
static void run_first_order(size_t n, const double *decay, const double *drive, double *out)
{
    double z = 0.0;
    for (size_t k = 0; k < n; ++k)
        out[k] = z = decay[k] * z + drive[k];
}

static int first_order_fits(const array *a)
{
    return has_length(&a[0], count(&a[1]), 0) && has_length(&a[2], count(&a[1]), 0);
}

static void first_order_runs(const array *a)
{
    run_first_order(count(&a[1]), numbers(&a[0]), numbers(&a[1]), numbers(&a[2]));
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

static int second_order_fits(const array *a)
{
    const size_t n = count(&a[3]);
    return has_length(&a[0], 3, 0) && has_length(&a[1], 2, 0) && has_length(&a[2], n, 0) &&
           has_length(&a[4], n, 0);
}

static void second_order_runs(const array *a)
{
    run_second_order(count(&a[3]), numbers(&a[0]), numbers(&a[1]), marks(&a[2]), numbers(&a[3]),
                     numbers(&a[4]));
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

static int resonance_fits(const array *a)
{
    const size_t n = count(&a[1]), decays = count(&a[2]) == 2 ? 2 : 2 * n;
    return has_length(&a[0], 2 * n, 0) && has_length(&a[2], decays, 0) &&
           has_length(&a[3], n, 0) && has_length(&a[4], 2, 0) && has_length(&a[5], 2 * n, 0);
}

static void resonance_runs(const array *a)
{
    run_resonance(count(&a[1]), numbers(&a[0]), numbers(&a[1]), numbers(&a[2]),
                  count(&a[2]) == 2 ? 0 : 2, marks(&a[3]), numbers(&a[4]), numbers(&a[5]));
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

static int plays_fit(const array *a)
{
    const size_t n = count(&a[0]);
    return has_length(&a[2], n, 0) && has_length(&a[3], count(&a[1]), 0) && has_length(&a[4], n, 0);
}

static void plays_run(const array *a)
{
    run_plays(count(&a[0]), count(&a[1]), numbers(&a[0]), numbers(&a[1]), marks(&a[2]),
              numbers(&a[3]), numbers(&a[4]));
}

static PyObject *called(const recursion *what, PyObject *args)
{
    arrays all = {.n = 0};
    if (PyTuple_Size(args) != what->n) {
        PyErr_Format(PyExc_TypeError, "found %zd arguments, needed %d", PyTuple_Size(args),
                     what->n);
        return NULL;
    }
    int good = 1;
    for (int i = 0; good && i < what->n; ++i)
        good = take(&all, PyTuple_GetItem(args, i), what->names[i], i >= what->written,
                    i == what->marks) != NULL;
    good = good && what->fits(all.item) && apart(&all);
    if (good) {
        Py_BEGIN_ALLOW_THREADS
        what->run(all.item);
        Py_END_ALLOW_THREADS
    }
    release(&all);
    return good ? Py_NewRef(Py_None) : NULL;
}

static PyObject *first_order(PyObject *module, PyObject *args)
{
    static const recursion what = {{"decay", "drive", "out"}, 3, 2, -1, first_order_fits,
                                   first_order_runs};
    (void)module;
    return called(&what, args);
}

static PyObject *second_order(PyObject *module, PyObject *args)
{
    static const recursion what = {{"above", "below", "starts", "values", "out"}, 5, 4, 2,
                                   second_order_fits, second_order_runs};
    (void)module;
    return called(&what, args);
}

static PyObject *resonance(PyObject *module, PyObject *args)
{
    static const recursion what = {{"wave", "rate", "decay", "starts", "pole", "out"}, 6, 5, 3,
                                   resonance_fits, resonance_runs};
    (void)module;
    return called(&what, args);
}

static PyObject *plays(PyObject *module, PyObject *args)
{
    static const recursion what = {{"torque", "radius", "starts", "state", "out"}, 5, 3, 2,
                                   plays_fit, plays_run};
    (void)module;
    return called(&what, args);
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
