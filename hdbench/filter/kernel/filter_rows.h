/* The samples of one chunk of one trace that has started, P as full rows in vectors of the
 * compiler. A template: define before each inclusion
 *   HDB_ROWS(name)            its names,
 *   HDB_VECTOR                doubles of a vector register,
 *   HDB_SLOTS, HDB_SLOW_SLOTS oscillators and slow torques that it has room for.
 * A model of fewer blocks leaves slots at zero, which changes no bit of any sum. Each number is the
 * same expression as in filter_recurse.h; the diagonal of P is kept apart, rows hold 0 there. */
#define V HDB_VECTOR
#define SLOTS (HDB_SLOTS + HDB_SLOW_SLOTS)
#define N (2 * SLOTS)
#define PARTS ((N + V - 1) / V)
#define WIDE (PARTS * V)
#define EACH_PART HDB_UNROLL for (int m = 0; m < PARTS; ++m)
#define EACH_ROW HDB_UNROLL for (int a = 0; a < N; ++a)
typedef double HDB_ROWS(part) __attribute__((vector_size(V * sizeof(double))));
typedef int64_t HDB_ROWS(index) __attribute__((vector_size(V * sizeof(double))));
#define part_of_row HDB_ROWS(part)
#define OF(array, i) (array)[(i) / V][(i) % V]
#define AT_LANE(array, i) ((double *)(array))[i] /* in memory */

typedef struct {
    part_of_row z[PARTS], d[PARTS], g[PARTS], p[N][PARTS];
} HDB_ROWS(filter);
#define filter HDB_ROWS(filter)

typedef struct { /* of one chunk, sample by sample */
    part_of_row c[HDB_CHUNK][PARTS], diagonal[HDB_CHUNK][PARTS];
    double seen[SLOTS][HDB_CHUNK], inverse[HDB_CHUNK], worst;
} HDB_ROWS(table);
#define table HDB_ROWS(table)

/* The model's block in a slot, or -1. */
HDB_INLINE int HDB_ROWS(block)(const hdb_model *model, int slot)
{
    if (slot < HDB_SLOTS)
        return slot < model->n_oscillators ? slot : -1;
    slot -= HDB_SLOTS;
    return slot < model->n_slow ? model->n_oscillators + slot : -1;
}

HDB_INLINE void HDB_ROWS(unpack)(const hdb_model *model, const lanes *s, filter *f)
{
    double z[WIDE] = {0}, d[WIDE] = {0}, p[N][WIDE];
    memset(p, 0, sizeof p);
    for (int a = 0; a < N; ++a) {
        const int own = HDB_ROWS(block)(model, a / 2), i = 2 * own + a % 2;
        if (own < 0)
            continue;
        z[a] = s->z[i];
        d[a] = s->p[AT(i, i)];
        for (int b = 0; b < a; ++b) {
            const int other = HDB_ROWS(block)(model, b / 2), j = 2 * other + b % 2;
            if (other >= 0)
                p[a][b] = p[b][a] = s->p[AT(i, j)];
        }
    }
    memcpy(f->z, z, sizeof z);
    memcpy(f->d, d, sizeof d);
    memcpy(f->p, p, sizeof p);
}

HDB_INLINE void HDB_ROWS(pack)(const hdb_model *model, const filter *f, lanes *s)
{
    double z[WIDE], d[WIDE], p[N][WIDE];
    memcpy(z, f->z, sizeof z);
    memcpy(d, f->d, sizeof d);
    memcpy(p, f->p, sizeof p);
    for (int a = 0; a < N; ++a) {
        const int own = HDB_ROWS(block)(model, a / 2), i = 2 * own + a % 2;
        if (own < 0)
            continue;
        s->z[i] = z[a];
        s->p[AT(i, i)] = d[a];
        for (int b = 0; b < a; ++b) {
            const int other = HDB_ROWS(block)(model, b / 2), j = 2 * other + b % 2;
            if (other >= 0)
                s->p[AT(i, j)] = p[a][b];
        }
    }
}

/* Register by register, so that a copy on the stack is none. */
HDB_INLINE void HDB_ROWS(copy)(const filter *from, filter *to)
{
    EACH_PART {
        to->z[m] = from->z[m];
        to->d[m] = from->d[m];
        EACH_ROW to->p[a][m] = from->p[a][m];
    }
}

/* Cosine and sine of each slot side by side; a slow torque is seen through (1, 0). */
HDB_INLINE void HDB_ROWS(arrange)(const hdb_model *model, const work *k, int n, table *t)
{
    static const double zero[HDB_CHUNK];
    const double *cosine[HDB_SLOTS], *sine[HDB_SLOTS];
    double slow[HDB_SLOW_SLOTS + 1];
    for (int b = 0; b < HDB_SLOTS; ++b) {
        cosine[b] = b < model->n_oscillators ? k->cosine[b] : zero;
        sine[b] = b < model->n_oscillators ? k->sine[b] : zero;
    }
    for (int b = 0; b < HDB_SLOW_SLOTS; ++b)
        slow[b] = b < model->n_slow;
    for (int i = 0; i < n; ++i) {
        HDB_UNROLL
        for (int b = 0; b < HDB_SLOTS; ++b) {
            AT_LANE(t->c[i], 2 * b) = cosine[b][i];
            AT_LANE(t->c[i], 2 * b + 1) = sine[b][i];
        }
        HDB_UNROLL
        for (int b = 2 * HDB_SLOTS; b < WIDE; ++b)
            AT_LANE(t->c[i], b) = b < N && b % 2 == 0 ? slow[b / 2 - HDB_SLOTS] : 0;
    }
}

#include "filter_rows_recurse.h"

#undef V
#undef SLOTS
#undef N
#undef PARTS
#undef WIDE
#undef EACH_PART
#undef EACH_ROW
#undef part_of_row
#undef OF
#undef AT_LANE
#undef filter
#undef table
