/* Recursion with P in rows, and what is reported of it. Part of the template of filter_rows.h. */

#if HDB_SLOW_SLOTS > 0
/* z <- F z, P <- F P F' + Q of the slow torque in a slot with the transition t. */
HDB_INLINE void HDB_ROWS(drift)(int slot, const double *t, filter *f)
{
    const int u = 2 * slot, v = u + 1, at = u / V, i = u % V, j = v % V;
    const double z0 = OF(f->z, u), z1 = OF(f->z, v);
    const double p11 = OF(f->d, u), p12 = OF(f->p[u], v), p22 = OF(f->d, v);
    const double t0 = t[0] * p11 + t[1] * p12, t1 = t[0] * p12 + t[1] * p22;
    const double u0 = t[2] * p11 + t[3] * p12, u1 = t[2] * p12 + t[3] * p22;
    part_of_row own = {0}, other = {0};
    own += 1.0;
    own[i] = t[0];
    own[j] = t[3];
    other[i] = t[1];
    other[j] = t[2];
    f->z[at][i] = t[0] * z0 + t[1] * z1;
    f->z[at][j] = t[2] * z0 + t[3] * z1;
    EACH_PART {
        const part_of_row above = f->p[u][m], below = f->p[v][m];
        f->p[u][m] = t[0] * above + t[1] * below;
        f->p[v][m] = t[2] * above + t[3] * below;
    }
    EACH_ROW {
        if (a != u && a != v)
            f->p[a][at] = f->p[a][at] * own + HDB_SWAPPED(f->p[a][at]) * other;
    }
    f->p[u][at][i] = f->p[v][at][j] = 0;
    f->p[u][at][j] = f->p[v][at][i] = (t0 * t[2] + t1 * t[3]) + t[5];
    f->d[at][i] = (t0 * t[0] + t1 * t[1]) + t[4];
    f->d[at][j] = (u0 * t[2] + u1 * t[3]) + t[6];
}
#endif

/* g = P C'; return S. `seen` takes what each block predicts, `predicted` their sum. */
HDB_INLINE double HDB_ROWS(project)(double r, const part_of_row *c, filter *f, double *seen,
                                    double *predicted)
{
    const double *const cs = (const double *)c;
    part_of_row zc[PARTS], gc[PARTS];
    EACH_PART {
        part_of_row sum = f->d[m] * c[m] + (f->p[0][m] * cs[0] + f->p[1][m] * cs[1]), rest = {0};
        HDB_UNROLL
        for (int b = 1; b < SLOTS; ++b) {
            const part_of_row more = f->p[2 * b][m] * cs[2 * b] + f->p[2 * b + 1][m] * cs[2 * b + 1];
            rest = b > 1 ? rest + more : more;
        }
        f->g[m] = sum + rest;
        zc[m] = f->z[m] * c[m];
        gc[m] = f->g[m] * c[m];
    }
    double ahead = 0, s = 0;
    HDB_UNROLL
    for (int b = 0; b < SLOTS; ++b) {
        const double g = OF(gc, 2 * b) + OF(gc, 2 * b + 1);
        seen[b] = OF(zc, 2 * b) + OF(zc, 2 * b + 1);
        ahead = b > 1 ? ahead + seen[b] : seen[b];
        if (b > 0)
            s = b > 1 ? s + g : g;
        else
            r += g;
    }
    *predicted = seen[0] + ahead;
    return r + s;
}

/* z <- z + g e / S, P <- P - g g' / S. */
HDB_INLINE void HDB_ROWS(measure)(double inverse, double e, filter *f)
{
    const double step = inverse * e;
    EACH_PART {
        f->z[m] += f->g[m] * step;
        f->d[m] -= inverse * (f->g[m] * f->g[m]);
    }
    EACH_ROW {
        EACH_PART {
            part_of_row less = inverse * (f->g[m] * OF(f->g, a));
            if (a / V == m) { /* 0 on the diagonal */
                HDB_ROWS(index) kept;
                memcpy(&kept, &HDB_BUT_ONE[7 - a % V], sizeof kept);
                less = (part_of_row)((HDB_ROWS(index))less & kept);
            }
            f->p[a][m] -= less;
        }
    }
}

/* What is reported of each sample, once the chunk is done. */
HDB_INLINE void HDB_ROWS(report)(const hdb_model *model, lanes *s, int n, work *k, const table *t)
{
    memset(k->part, 0, sizeof k->part);
    for (int b = 0; b < SLOTS; ++b) {
        const int own = HDB_ROWS(block)(model, b);
        double *const part = k->part[own < 0 ? 0 : model->block[own].part];
        for (int i = 0; i < n; ++i)
            part[i] += t->seen[b][i];
    }
    double used = s->used, squares = s->squares, product = s->product;
    for (int i = 0; i < n; ++i) {
        const int taken = k->flag[i] == 0;
        const double e = taken ? k->innovation[i] : 0;
        used += taken;
        squares += e * e * t->inverse[i];
        product *= taken ? k->variance[i] : 1;
        if (++s->since == 8) {
            s->since = 0;
            if (!(product > 1e-150 && product < 1e150)) {
                s->log_sum += log(product);
                product = 1;
            }
        }
    }
    s->used = used;
    s->squares = squares;
    s->product = product;
    for (int i = 0; i < n; ++i)
        k->filtered[i] = k->torque[i] - (k->part[0][i] + k->part[1][i]);
    double least = k->variance[0];
    for (int i = 1; i < n; ++i)
        least = k->variance[i] < least ? k->variance[i] : least;
    if (t->worst <= HDB_RESOLVED * least)
        return; /* every block is resolved */
    for (int i = 0; i < n; ++i) {
        const double limit = HDB_RESOLVED * k->variance[i];
        int found = 0;
        HDB_UNROLL
        for (int b = 0; b < HDB_SLOTS; ++b)
            found |= AT_LANE(t->diagonal[i], 2 * b) + AT_LANE(t->diagonal[i], 2 * b + 1) > limit;
        k->flag[i] += found ? HDB_UNRESOLVED : 0;
    }
}

HDB_APART void HDB_ROWS(recurse)(const hdb_model *model, lanes *s, filter *kept, int n, work *k)
{
    filter own, *const f = &own;
    table t;
    part_of_row base[PARTS], turned[PARTS], timed[PARTS], most[PARTS];
    double gated = s->head[HDB_GATED_RUN];
    int steady = 1;
    HDB_ROWS(arrange)(model, k, n, &t);
    HDB_ROWS(copy)(kept, f);
    EACH_PART base[m] = turned[m] = timed[m] = most[m] = (part_of_row){0};
    for (int a = 0; a < 2 * HDB_SLOTS; ++a) {
        const int b = HDB_ROWS(block)(model, a / 2);
        OF(base, a) = b < 0 ? 0 : model->block[b].q_sample;
        OF(turned, a) = b < 0 ? 0 : model->block[b].q_rad;
        OF(timed, a) = b < 0 ? 0 : model->block[b].q_s;
        steady = steady && !(OF(turned, a) > 0 || OF(timed, a) > 0);
    }
    for (int i = 0; i < n; ++i) {
#if HDB_SLOW_SLOTS > 0
        HDB_UNROLL
        for (int b = 0; b < HDB_SLOW_SLOTS; ++b) {
            if (b < model->n_slow)
                HDB_ROWS(drift)(HDB_SLOTS + b, k->f[b][i], f);
        }
#endif
        EACH_PART {
            part_of_row noise = base[m];
            if (!steady)
                noise = (noise + turned[m] * hdb_abs(k->turn[i])) + timed[m] * k->dt[i];
            f->d[m] += noise;
        }
        double predicted, seen[SLOTS];
        const double variance = HDB_ROWS(project)(model->r, t.c[i], f, seen, &predicted);
        for (int b = 0; b < SLOTS; ++b)
            t.seen[b][i] = seen[b];
        const double innovation = k->residual[i] - predicted;
        int flag = k->residual[i] == k->residual[i] ? 0 : HDB_MISSING;
        if (model->gate > 0 && !flag) {
            const int beyond = innovation * innovation > model->gate * variance &&
                               gated < model->gate_samples;
            flag = beyond ? HDB_GATED : 0;
            gated = beyond ? gated + 1 : 0;
        }
        const double inverse = flag ? 0 : 1.0 / variance;
        HDB_ROWS(measure)(inverse, flag ? 0 : innovation, f);
        EACH_PART {
            t.diagonal[i][m] = f->d[m];
            const HDB_ROWS(index) more = f->d[m] > most[m];
            most[m] = (part_of_row)((more & (HDB_ROWS(index))f->d[m]) |
                                    (~more & (HDB_ROWS(index))most[m]));
        }
        k->innovation[i] = innovation;
        k->variance[i] = variance;
        k->flag[i] = flag;
        t.inverse[i] = inverse;
    }
    t.worst = 0; /* a bound of every sum of two */
    for (int a = 0; a < 2 * HDB_SLOTS; ++a)
        t.worst = 2 * OF(most, a) > t.worst ? 2 * OF(most, a) : t.worst;
    HDB_ROWS(copy)(f, kept);
    s->head[HDB_GATED_RUN] = gated;
    HDB_ROWS(report)(model, s, n, k, &t);
}
