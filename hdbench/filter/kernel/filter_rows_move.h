/* What transitions and measurements do to z and P, in rows. Part of the template of
 * filter_rows.h. */

#if HDB_SLOW_SLOTS > 0
/* z <- F z, g <- F g, P <- F P F' + Q of the slow torque in a slot with the transition t. */
HDB_INLINE void HDB_ROWS(drift)(int slot, const double *t, filter *f)
{
    const int u = 2 * slot, v = u + 1, at = u / V, i = u % V, j = v % V;
    const double p11 = OF(f->d, u), p12 = OF(f->p[u], v), p22 = OF(f->d, v);
    const double t0 = t[0] * p11 + t[1] * p12, t1 = t[0] * p12 + t[1] * p22;
    const double u0 = t[2] * p11 + t[3] * p12, u1 = t[2] * p12 + t[3] * p22;
    part_of_row own = {0}, other = {0};
    own += 1.0;
    own[i] = t[0];
    own[j] = t[3];
    other[i] = t[1];
    other[j] = t[2];
    f->z[at] = f->z[at] * own + HDB_MOVED(f->z[at], HDB_PAIRS) * other;
    f->g[at] = f->g[at] * own + HDB_MOVED(f->g[at], HDB_PAIRS) * other;
    EACH_PART {
        const part_of_row above = f->p[u][m], below = f->p[v][m];
        f->p[u][m] = t[0] * above + t[1] * below;
        f->p[v][m] = t[2] * above + t[3] * below;
    }
    EACH_ROW {
        if (a != u && a != v)
            f->p[a][at] = f->p[a][at] * own + HDB_MOVED(f->p[a][at], HDB_PAIRS) * other;
    }
    f->p[u][at][i] = f->p[v][at][j] = 0;
    f->p[u][at][j] = f->p[v][at][i] = (t0 * t[2] + t1 * t[3]) + t[5];
    f->d[at][i] = (t0 * t[0] + t1 * t[1]) + t[4];
    f->d[at][j] = (u0 * t[2] + u1 * t[3]) + t[6];
}
#endif

/* Sum of the lanes in the order of filter_recurse.h's `along`, in every lane. */
HDB_INLINE part_of_row HDB_ROWS(folded)(const part_of_row *x)
{
    part_of_row sum[8 / V];
    HDB_UNROLL
    for (int m = 0; m < 8 / V; ++m)
        sum[m] = m < PARTS ? x[m] : (part_of_row){0};
    HDB_UNROLL
    for (int m = 8 / V; m < PARTS; ++m)
        sum[m % (8 / V)] += x[m];
#if HDB_VECTOR == 8
    const part_of_row half = sum[0] + HDB_MOVED(sum[0], HDB_HALVES);
    const part_of_row pair = half + HDB_MOVED(half, HDB_QUARTERS);
#elif HDB_VECTOR == 4
    const part_of_row half = sum[0] + sum[1], pair = half + HDB_MOVED(half, HDB_HALVES);
#else
    const part_of_row pair = (sum[0] + sum[2]) + (sum[1] + sum[3]);
#endif
    return pair + HDB_MOVED(pair, HDB_PAIRS);
}

HDB_INLINE part_of_row HDB_ROWS(along)(const part_of_row *c, const part_of_row *x)
{
    part_of_row each[PARTS];
    EACH_PART each[m] = x[m] * c[m];
    return HDB_ROWS(folded)(each);
}

#ifdef HDB_TRIANGLE
#include "filter_triangle.h"
#else
/* Row `a` times a number. */
HDB_INLINE part_of_row HDB_ROWS(row)(const filter *f, int a, int m, double by)
{
    return f->p[a][m] * by;
}

/* Lane `a` of g everywhere, but 0 in lane a itself; all of it of a part that has not this lane. */
HDB_INLINE part_of_row HDB_ROWS(spread)(const part_of_row *g, int a, int m)
{
#if defined(__GNUC__) && !defined(__clang__)
    HDB_ROWS(index) from = {0};
    from += a % V;
    if (a / V == m)
        from[a % V] = V;
    return __builtin_shuffle(g[a / V], (part_of_row){0}, from);
#else
    part_of_row all = {0};
    all += OF(g, a);
    if (a / V == m)
        all[a % V] = 0;
    return all;
#endif
}

/* z <- z + g e / S, P <- P - g g' / S. */
HDB_INLINE void HDB_ROWS(settle)(filter *f)
{
    EACH_PART {
        f->z[m] += f->g[m] * f->step;
        f->d[m] -= f->inverse * (f->g[m] * f->g[m]);
    }
    EACH_ROW {
        EACH_PART f->p[a][m] -= f->inverse * (f->g[m] * HDB_ROWS(spread)(f->g, a, m));
    }
}

/* C x of two x. */
HDB_INLINE void HDB_ROWS(both)(const part_of_row *c, const part_of_row *x, const part_of_row *y,
                               part_of_row *of_x, part_of_row *of_y)
{
    *of_x = HDB_ROWS(along)(c, x);
    *of_y = HDB_ROWS(along)(c, y);
}
#endif

/* b = P C'. */
HDB_INLINE void HDB_ROWS(project)(const part_of_row *c, const filter *f, part_of_row *b)
{
    const double *const cs = (const double *)c;
    EACH_PART {
        part_of_row sum = f->d[m] * c[m], rest = {0};
        sum += HDB_ROWS(row)(f, 0, m, cs[0]) + HDB_ROWS(row)(f, 1, m, cs[1]);
        HDB_UNROLL
        for (int i = 1; i < SLOTS; ++i) {
            part_of_row more = HDB_ROWS(row)(f, 2 * i, m, cs[2 * i]);
            more += HDB_ROWS(row)(f, 2 * i + 1, m, cs[2 * i + 1]);
            rest = i > 1 ? rest + more : more;
        }
        b[m] = sum + rest;
    }
}
