/* Arrays of a call from Python: buffers taken, checked, released. */
#ifndef HDBENCH_NATIVE_ARRAYS_H
#define HDBENCH_NATIVE_ARRAYS_H

#include <Python.h>

#include <string.h>

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

#endif
