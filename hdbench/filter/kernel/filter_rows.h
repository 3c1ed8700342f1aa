/* The samples of one chunk of one trace that has started, P as full rows in vectors of the
 * compiler. A template: define before each inclusion
 *   HDB_ROWS(name)            its names,
 *   HDB_VECTOR                doubles of a vector register,
 *   HDB_SLOTS, HDB_SLOW_SLOTS oscillators and slow torques that it has room for,
 *   HDB_TRIANGLE              only where filter_triangle.h is to keep P: its places.
 * A model of fewer blocks leaves slots at zero, which changes no bit of any sum. Each number is the
 * same expression as in filter_recurse.h; the diagonal of P is kept apart, rows hold 0 there. */
#define V HDB_VECTOR
#define SLOTS (HDB_SLOTS + HDB_SLOW_SLOTS)
#define N (2 * SLOTS)
#define PARTS ((N + V - 1) / V)
#define WIDE (PARTS * V)
#define EACH_PART HDB_UNROLL for (int m = 0; m < PARTS; ++m)
#define EACH_ROW HDB_UNROLL for (int a = 0; a < N; ++a)
#ifdef HDB_TRIANGLE
#define HELD 2 /* registers of P */
#else
#define HELD N
#endif
typedef double HDB_ROWS(part) __attribute__((vector_size(V * sizeof(double))));
typedef int64_t HDB_ROWS(index) __attribute__((vector_size(V * sizeof(double))));
#define part_of_row HDB_ROWS(part)
#define OF(array, i) (array)[(i) / V][(i) % V]
#define AT_LANE(array, i) ((double *)(array))[i] /* in memory */
#define EVERYWHERE(x) ((x) - (part_of_row){0}) /* to the bit, as adding 0 is not */

typedef struct {
    part_of_row z[PARTS], d[PARTS], g[PARTS], p[HELD][PARTS];
    part_of_row inverse, step; /* of the measurement to be done, in every lane */
#ifdef HDB_TRIANGLE
    __mmask8 others[6]; /* lanes of all other states */
#endif
} HDB_ROWS(filter);
#define filter HDB_ROWS(filter)

typedef struct { /* of one chunk, sample by sample */
    part_of_row c[HDB_CHUNK][PARTS], seen[HDB_CHUNK][PARTS], d[HDB_CHUNK][PARTS];
    part_of_row g[HDB_CHUNK][PARTS];
    double inverse[HDB_CHUNK], worst, least;
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

/* Where P(a, b) is kept; (a, b) and (b, a) may be one number, or two of the same value. */
HDB_INLINE int HDB_ROWS(place)(int a, int b)
{
#ifdef HDB_TRIANGLE
    static const int places[6][6] = HDB_TRIANGLE;
    return places[a][b];
#else
    return a * WIDE + b;
#endif
}

HDB_INLINE void HDB_ROWS(unpack)(const hdb_model *model, const lanes *s, filter *f, table *t)
{
    double z[WIDE] = {0}, g[WIDE] = {0}, d[WIDE] = {0}, p[HELD * WIDE] = {0};
    for (int a = 0; a < N; ++a) {
        const int own = HDB_ROWS(block)(model, a / 2), i = 2 * own + a % 2;
        if (own < 0)
            continue;
        z[a] = s->z[i];
        g[a] = s->g[i];
        d[a] = s->p[AT(i, i)];
        for (int b = 0; b < a; ++b) {
            const int other = HDB_ROWS(block)(model, b / 2), j = 2 * other + b % 2;
            if (other >= 0)
                p[HDB_ROWS(place)(a, b)] = p[HDB_ROWS(place)(b, a)] = s->p[AT(i, j)];
        }
    }
    f->inverse = EVERYWHERE(s->head[HDB_INVERSE]);
    f->step = EVERYWHERE(s->head[HDB_STEP]);
    memset(t->c, 0, sizeof t->c);
    for (int i = 0; i < HDB_CHUNK; ++i)
        for (int b = 0; b < model->n_slow && HDB_SLOW_SLOTS > 0; ++b)
            AT_LANE(t->c[i], 2 * (HDB_SLOTS + b)) = 1; /* a slow torque is seen through (1, 0) */
    memcpy(f->z, z, sizeof z);
    memcpy(f->g, g, sizeof g);
    memcpy(f->d, d, sizeof d);
    memcpy(f->p, p, sizeof p);
}

HDB_INLINE void HDB_ROWS(pack)(const hdb_model *model, const filter *f, lanes *s)
{
    double z[WIDE], g[WIDE], d[WIDE], p[HELD * WIDE];
    s->head[HDB_INVERSE] = f->inverse[0];
    s->head[HDB_STEP] = f->step[0];
    memcpy(z, f->z, sizeof z);
    memcpy(g, f->g, sizeof g);
    memcpy(d, f->d, sizeof d);
    memcpy(p, f->p, sizeof p);
    for (int a = 0; a < N; ++a) {
        const int own = HDB_ROWS(block)(model, a / 2), i = 2 * own + a % 2;
        if (own < 0)
            continue;
        s->z[i] = z[a];
        s->g[i] = g[a];
        s->p[AT(i, i)] = d[a];
        for (int b = 0; b < a; ++b) {
            const int other = HDB_ROWS(block)(model, b / 2), j = 2 * other + b % 2;
            if (other >= 0)
                s->p[AT(i, j)] = p[HDB_ROWS(place)(a, b)];
        }
    }
}

/* Register by register, so that a copy on the stack is none. */
HDB_INLINE void HDB_ROWS(copy)(const filter *from, filter *to)
{
    to->inverse = from->inverse;
    to->step = from->step;
#ifdef HDB_TRIANGLE
    HDB_UNROLL
    for (int a = 0; a < 6; ++a) {
        to->others[a] = (__mmask8)(0x3f & ~(1 << a));
        __asm__("" : "+Yk"(to->others[a])); /* in a register: else built anew at every sample */
    }
#endif
    EACH_PART {
        to->z[m] = from->z[m];
        to->g[m] = from->g[m];
        to->d[m] = from->d[m];
        HDB_UNROLL
        for (int a = 0; a < HELD; ++a)
            to->p[a][m] = from->p[a][m];
    }
}

/* Cosine and sine of each slot side by side. */
HDB_INLINE void HDB_ROWS(arrange)(int no, const work *k, int n, table *t)
{
    for (int i = 0; i < n; ++i) {
        HDB_UNROLL
        for (int b = 0; b < no; ++b) {
            const hdb_two two = {k->cosine[b][i], k->sine[b][i]};
            memcpy(&AT_LANE(t->c[i], 2 * b), &two, sizeof two);
        }
    }
}

#include "filter_rows_move.h"
#include "filter_rows_report.h"
#include "filter_rows_recurse.h"

#undef V
#undef SLOTS
#undef N
#undef PARTS
#undef WIDE
#undef EACH_PART
#undef EACH_ROW
#undef HELD
#undef part_of_row
#undef OF
#undef AT_LANE
#undef EVERYWHERE
#undef filter
#undef table
#undef tally
