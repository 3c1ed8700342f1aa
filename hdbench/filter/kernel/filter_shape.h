/* z and P of the template of filter_recurse.h in either shape, and what is done to them. */

#ifdef HDB_ROWS
#define V HDB_VECTOR
#define PARTS (HDB_ROW_STATES / V)
#define EACH_PART for (int m = 0; m < PARTS; ++m)
typedef hdb_real HDB_SHAPE(part) __attribute__((vector_size(V * sizeof(hdb_real))));
#define part_of_row HDB_SHAPE(part)
typedef struct {
    part_of_row z[PARTS], g[PARTS], p[HDB_ROW_STATES][PARTS], diagonal[PARTS];
} HDB_SHAPE(filter);
#define Z(i) f->z[(i) / V][(i) % V]
#define G(i) f->g[(i) / V][(i) % V]
#define D(i) f->diagonal[(i) / V][(i) % V]
#define P(i, j) f->p[i][(j) / V][(j) % V]
#else
typedef struct {
    lanes *s;
    number g[STATES];
} HDB_SHAPE(filter);
#define Z(i) f->s->z[i]
#define G(i) f->g[i]
#define D(i) f->s->p[AT(i, i)]
#define P(i, j) f->s->p[(i) > (j) ? AT(i, j) : AT(j, i)]
#endif
#define filter HDB_SHAPE(filter)

#ifdef HDB_ROWS
HDB_INLINE void HDB_SHAPE(unpack)(int nb, const lanes *s, filter *f)
{
    *f = (filter){0};
    for (int i = 0; i < 2 * nb; ++i) {
        Z(i) = s->z[i];
        for (int j = 0; j <= i; ++j)
            P(i, j) = P(j, i) = s->p[AT(i, j)];
        D(i) = P(i, i);
    }
}

HDB_INLINE void HDB_SHAPE(pack)(int nb, const filter *f, lanes *s)
{
    for (int i = 0; i < 2 * nb; ++i) {
        s->z[i] = Z(i);
        for (int j = 0; j <= i; ++j)
            s->p[AT(i, j)] = P(i, j);
    }
}
#endif

/* z <- F z, P <- F P F' + Q of slow block b with the transition t. */
HDB_INLINE void HDB_SHAPE(drift)(int nb, int b, const hdb_real *t, filter *f)
{
    const int u = 2 * b, v = 2 * b + 1;
    const number z0 = Z(u), z1 = Z(v), p11 = P(u, u), p12 = P(u, v), p22 = P(v, v);
    const number t0 = t[0] * p11 + t[1] * p12, t1 = t[0] * p12 + t[1] * p22;
    const number u0 = t[2] * p11 + t[3] * p12, u1 = t[2] * p12 + t[3] * p22;
    const number q11 = (t0 * t[0] + t1 * t[1]) + t[4], q12 = (t0 * t[2] + t1 * t[3]) + t[5];
    const number q22 = (u0 * t[2] + u1 * t[3]) + t[6];
    Z(u) = t[0] * z0 + t[1] * z1;
    Z(v) = t[2] * z0 + t[3] * z1;
#ifdef HDB_ROWS
    HDB_UNROLL
    EACH_PART {
        const part_of_row above = f->p[u][m], below = f->p[v][m];
        f->p[u][m] = t[0] * above + t[1] * below;
        f->p[v][m] = t[2] * above + t[3] * below;
    }
    HDB_UNROLL
    for (int j = 0; j < 2 * nb; ++j) { /* columns as rows, within a register */
        part_of_row both = f->p[j][u / V];
        both[u % V] = P(u, j);
        both[v % V] = P(v, j);
        f->p[j][u / V] = both;
    }
    P(v, u) = q12;
#else
    for (int j = 0; j < 2 * nb; ++j) {
        const number above = P(u, j), below = P(v, j);
        P(u, j) = t[0] * above + t[1] * below;
        P(v, j) = t[2] * above + t[3] * below;
    }
#endif
    P(u, v) = q12;
    P(u, u) = q11;
    P(v, v) = q22;
#ifdef HDB_ROWS
    D(u) = q11;
    D(v) = q22;
#endif
}

#ifdef HDB_SINGLE
/* Variance that the data do not bound (standstill) grows until a float's P loses its sign: beyond
 * a limit, rows and columns of the block shrink by what the noise would add. */
HDB_INLINE void HDB_SHAPE(hold)(int nb, int b, hdb_real r, hdb_real noise, filter *f)
{
    const hdb_real both = D(2 * b) + D(2 * b + 1);
    if (!(both > HDB_HELD * (r + noise)))
        return;
    const hdb_real less = K(1.0) - noise / both;
    for (int a = 2 * b; a < 2 * b + 2; ++a) {
        for (int j = 0; j < 2 * nb; ++j)
            P(a, j) *= less;
        P(a, a) *= less;
    }
}
#endif

/* What the blocks of each part predict; then P has the noise of its step. */
HDB_INLINE void HDB_SHAPE(predict)(int no, int nb, const hdb_model *model, work *k, int i,
                                   filter *f)
{
    const number none = {0};
    number part[3] = {none, none, none};
    HDB_UNROLL
    for (int b = 0; b < no; ++b) {
        const number seen = Z(2 * b) * k->cosine[b][i] + Z(2 * b + 1) * k->sine[b][i];
        const number noise = k->noise[b][i];
#ifdef HDB_SINGLE
        HDB_SHAPE(hold)(nb, b, model->r, noise, f);
#endif
        HDB_UNROLL
        for (int a = 2 * b; a < 2 * b + 2; ++a) {
#ifdef HDB_ROWS /* only column a; the others add 0 */
            part_of_row unit = {0};
            unit[a % V] = 1;
            f->p[a][a / V] += unit * noise;
            f->diagonal[a / V] += unit * noise;
#else
            P(a, a) += noise;
#endif
        }
        if (model->block[b].part == HDB_RIPPLE)
            part[0] += seen;
        else
            part[1] += seen;
    }
    for (int b = no; b < nb; ++b) {
        HDB_SHAPE(drift)(nb, b, k->f[b - no][i], f);
        part[2] += Z(2 * b);
    }
    k->innovation[i] = k->residual[i] - ((part[0] + part[1]) + part[2]);
    k->part[0][i] = part[0];
    k->part[1][i] = part[1];
    k->part[2][i] = part[2];
    k->filtered[i] = k->torque[i] - (part[0] + part[1]);
}

/* g = P C', block after block. */
HDB_INLINE void HDB_SHAPE(project)(int no, int nb, const work *k, int i, filter *f)
{
    HDB_UNROLL
    for (int b = 0; b < nb; ++b) {
#ifdef HDB_ROWS
        EACH_PART {
            part_of_row sum = f->p[2 * b][m];
            if (b < no)
                sum = sum * k->cosine[b][i] + f->p[2 * b + 1][m] * k->sine[b][i];
            f->g[m] = b > 0 ? f->g[m] + sum : sum;
        }
#else
        HDB_UNROLL
        for (int j = 0; j < 2 * nb; ++j) {
            number sum = P(2 * b, j);
            if (b < no)
                sum = sum * k->cosine[b][i] + P(2 * b + 1, j) * k->sine[b][i];
            G(j) = b > 0 ? G(j) + sum : sum;
        }
#endif
    }
}
