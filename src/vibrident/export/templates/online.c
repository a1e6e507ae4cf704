/*
@ABOUT@
 */
#include "@N@.h"
#include <math.h>
#include <stddef.h>
#include <string.h>
#define N @GUARD@_ORDER
#define P @GUARD@_PARAMETERS
#define Q @GUARD@_INPUTS
#define M @GUARD@_M
#define K (N + 1)
#define AR @GUARD@_AR
#define LEVELS @GUARD@_LEVELS
#define PARTS @GUARD@_PARTS
#define TAPS @GUARD@_TAPS
#define E (N + Q)
#define AT(i, j) ((i) * (2 * M + 1 - (i)) / 2 + (j)) /* place in an upper triangle, by rows */
#define WHOLE (AT(M, M) + 1)
#define EACH(i, n) for ((i) = 0; (i) < (n); (i)++)
#define EACH2(i, n, j, m) EACH(i, n) EACH(j, m)
typedef @N@_tracker tracker;
typedef @N@_real real;

/* ---- constants of the certificate ---- */
static const double INTERVAL = @INTERVAL@;
#if P > 3
static const double DELAY = @DELAY@; /* at which the inputs are interpolated, s */
#endif
static const int FIRST = @FIRST@; /* sample of the first tap, counted from the step's */
static const double SCALE[P] = {@SCALE@}, START[P] = {@START@}, PRIOR[P][P] = {@PRIOR@};
static const int POSITIVE[P] = {@POSITIVE@}, WALKS[P] = {@WALKS@}; /* in units of the value, else of the scale */
static const double DRIFT_RATE = @DRIFT_RATE@, REFERENCE_U = @REFERENCE_U@; /* variance a second; relative */
static const double CHANGE[PARTS + LEVELS][P] = {@CHANGE@};
static const double NOISE[PARTS + LEVELS] = {@NOISE@}, LOUDER[PARTS] = {@LOUDER@}, FURTHER[P] = {@FURTHER@};
static const real FILTER[TAPS][Q] = {@FILTER@};
static const real CORRECTOR[3][@GUARD@_CORRECTOR_TAPS] = {@CORRECTOR@};

static const double EXCITED = @EXCITED@, NONE = @NONE@, LEFT = @LEFT@, WITHIN = @WITHIN@, ALONE = @ALONE@, FURTHEST = @FURTHEST@;
static const double NORMAL = 3.0, SEEN = 1.0, OPENED = 2.0, TINY = 1e-300, TURN = 6.283185307179586;

/* ---- the cell ---- */
/* C = A B, or += where add. */
static void product(double a[E][E], double b[E][E], double c[E][E], int add) {
    int i, j, k;
    EACH2(i, E, j, E) {
        double sum = add ? c[i][j] : 0.0;
        EACH(k, E) sum += a[i][k] * b[k][j];
        c[i][j] = sum;
    }
}

/* Exponential of a matrix and its derivative: scaling, Taylor series, squaring, of value and derivative together. */
static void exponential(double g[E][E], double dg[E][E], double out[E][E], double dout[E][E]) {
    double norm = 0.0, factor, next[E][E], dnext[E][E];
    int i, j, k, squarings;
    EACH(j, E) {
        double sum = 0.0;
        EACH(i, E) sum += fabs(g[i][j]);
        norm = fmax(norm, sum);
    }
    squarings = (int)ceil(log2(fmax(norm, TINY))) + 1;
    if (squarings < 0) squarings = 0;
    factor = ldexp(1.0, -squarings);
    EACH2(i, E, j, E) { g[i][j] *= factor; dg[i][j] *= factor; out[i][j] = i == j; dout[i][j] = 0.0; }
    for (k = 18; k > 0; k--) {
        product(g, out, next, 0); product(g, dout, dnext, 0); product(dg, out, dnext, 1);
        EACH2(i, E, j, E) { out[i][j] = next[i][j] / k + (i == j); dout[i][j] = dnext[i][j] / k; }
    }
    EACH(k, squarings) {
        product(out, out, next, 0); product(out, dout, dnext, 0); product(dout, out, dnext, 1);
        memcpy(out, next, sizeof next); memcpy(dout, dnext, sizeof dnext);
    }
}

/* One number and its derivative by one of the parameters. */
typedef struct { double v, d; } dual;
static dual times(dual a, dual b) { return (dual){a.v * b.v, a.v * b.d + a.d * b.v}; }

/* Weights at the point and their derivatives by parameter p. */
static void weights(tracker *t, int p) {
    double g[E][E] = {{0}}, dg[E][E] = {{0}}, part[E][E], dpart[E][E], whole[E][E], dwhole[E][E], size;
    dual value[P], w, delta, gain, b, f;
    int i, j;
    EACH(i, P) { value[i].v = t->point[K + i] * SCALE[i]; value[i].d = i == p ? SCALE[i] : 0.0; }
    gain = value[0]; w = times(value[1], (dual){TURN, 0.0}); delta = value[2]; b = times(w, gain);
    frexp(fabs(b.v) / fabs(w.v), &i); size = ldexp(1.0, i); g[0][1] = INTERVAL * w.v; dg[0][1] = INTERVAL * w.d;
    g[1][0] = -g[0][1]; dg[1][0] = -dg[0][1]; g[1][1] = -2.0 * INTERVAL * times(w, delta).v;
    dg[1][1] = -2.0 * INTERVAL * times(w, delta).d;
    EACH(j, Q) {
        double sign = j % 2 ? -1.0 : 1.0;
        g[1][N + j] = INTERVAL * b.v / size * sign; dg[1][N + j] = INTERVAL * b.d / size * sign;
        for (i = j - 1; i >= 0; i -= 2) g[N + i][N + j] = 2.0 * (2.0 * i + 1.0);
    }
    f.v = f.d = 0.0;
#if P > 3
    f.v = (DELAY - value[3].v) / INTERVAL; f.d = -value[3].d / INTERVAL;
#endif
    EACH2(i, E, j, E) { part[i][j] = g[i][j] * f.v; dpart[i][j] = g[i][j] * f.d + dg[i][j] * f.v; }
    exponential(g, dg, whole, dwhole); memcpy(g, part, sizeof g); memcpy(dg, dpart, sizeof dg);
    exponential(g, dg, part, dpart);
    EACH(i, N) {
        EACH(j, N) { t->phi[i][j] = (real)whole[i][j]; t->d_phi[p][i][j] = (real)dwhole[i][j]; }
        EACH(j, Q) {
            t->gamma[i][j] = (real)(size * whole[i][N + j]); t->d_gamma[p][i][j] = (real)(size * dwhole[i][N + j]);
        }
    }
    EACH(j, N) { t->c[j] = (real)part[0][j]; t->d_c[p][j] = (real)dpart[0][j]; }
    EACH(j, Q) { t->d[j] = (real)(size * part[0][N + j]); t->d_d[p][j] = (real)(size * dpart[0][N + j]); }
}
static void linearise(tracker *t) {
    double gain = t->point[K] * SCALE[0], w = TURN * t->point[K + 1] * SCALE[1];
    int p;
    EACH(p, P) weights(t, p);
    t->coefficient[0] = (real)(1.0 / gain); t->coefficient[1] = (real)(2.0 * t->point[K + 2] * SCALE[2] / w / gain);
    t->coefficient[2] = (real)(1.0 / (w * w) / gain);
}

/* ---- square-root information ---- */
static void triangle(double gram[M + 1][M + 1], double upper[M + 1][M + 1]) {
    double left[M + 1][M + 1];
    int i, j, k;
    memcpy(left, gram, sizeof left); memset(upper, 0, sizeof left);
    EACH(k, M + 1) {
        double pivot = left[k][k];
        if (!(pivot > WITHIN * gram[k][k] || (k == M && pivot > 0.0))) continue;
        for (j = k; j <= M; j++) upper[k][j] = left[k][j] / sqrt(pivot);
        for (i = k; i <= M; i++)
            for (j = k; j <= M; j++) left[i][j] -= upper[k][i] * upper[k][j];
    }
}

/* Rotate a row into the triangle, from a column on. */
static void rotate(double known[M][M + 1], double row[M + 1], int from) {
    int j, k;
    for (k = from; k < M; k++) {
        double a = known[k][k], b = row[k], r = hypot(a, b);
        if (b == 0.0) continue;
        for (j = k; j <= M; j++) {
            double upper = known[k][j], lower = row[j];
            known[k][j] = (a * upper + b * lower) / r; row[j] = (a * lower - b * upper) / r;
        }
    }
}
static void absorb(double known[M][M + 1], double upper[M + 1][M + 1], double by) {
    int i, j;
    EACH2(i, M, j, M + 1) upper[i][j] *= by;
    EACH(i, M) rotate(known, upper[i], i);
}

/* One parameter after another moves by a random step: [1/s 0; -R_p R], its first column rotated away. */
static void walk(double known[M][M + 1], const double variance[P]) {
    int i, j, p;
    EACH(p, P) {
        double top[M + 2] = {0}, next[M][M + 1], rest[M + 1];
        if (!(variance[p] > 0.0)) continue;
        top[0] = 1.0 / sqrt(variance[p]); memset(next, 0, sizeof next);
        EACH(i, M) {
            double first = -known[i][K + p], r = hypot(top[0], first);
            EACH(j, M + 1) {
                double above = top[j + 1], below = known[i][j];
                rest[j] = (top[0] * below - first * above) / r; top[j + 1] = (top[0] * above + first * below) / r;
            }
            top[0] = r; rotate(next, rest, 0);
        }
        memcpy(known, next, sizeof next);
    }
}
static void solve(double known[M][M + 1], double found[M]) {
    int j, k;
    for (k = M - 1; k >= 0; k--) {
        found[k] = 0.0;
        if (known[k][k] > 0.0) {
            double sum = known[k][M];
            for (j = k + 1; j < M; j++) sum -= known[k][j] * found[j];
            found[k] = sum / known[k][k];
        }
    }
}
static void shift(double gram[M + 1][M + 1], const double move[M]) {
    int i, j;
    EACH2(i, M + 1, j, M) gram[i][M] -= gram[i][j] * move[j];
    EACH2(j, M + 1, i, M) gram[M][j] -= move[i] * gram[i][j];
}
static void without_nuisances(double gram[M + 1][M + 1]) {
    double upper[M + 1][M + 1];
    int i, j, k;
    triangle(gram, upper);
    EACH2(i, M + 1, j, M + 1) {
        gram[i][j] = 0.0;
        for (k = K; k <= M; k++) gram[i][j] += upper[k][i] * upper[k][j];
    }
}

/* ---- tests of a change ---- */
static void swap(double *a, double *b) { double held = *a; *a = *b; *b = held; }

/* Solve A X = B, A symmetric and positive, scaled by its diagonal; B is replaced. */
static void regular(double *a, double *b, int n, int columns) {
    int i, j, k;
    EACH(k, n) {
        int best = k;
        for (i = k + 1; i < n; i++)
            if (fabs(a[i * n + k]) > fabs(a[best * n + k])) best = i;
        EACH(j, n) swap(&a[k * n + j], &a[best * n + j]);
        EACH(j, columns) swap(&b[k * columns + j], &b[best * columns + j]);
        for (i = k + 1; i < n; i++) {
            double share = a[i * n + k] / a[k * n + k];
            for (j = k; j < n; j++) a[i * n + j] -= share * a[k * n + j];
            EACH(j, columns) b[i * columns + j] -= share * b[k * columns + j];
        }
    }
    EACH(j, columns)
        for (i = n - 1; i >= 0; i--) {
            for (k = i + 1; k < n; k++) b[i * columns + j] -= a[i * n + k] * b[k * columns + j];
            b[i * columns + j] /= a[i * n + i];
        }
}
static void inverse(double matrix[P][P], double out[P][P]) {
    double a[P * P];
    int i, j;
    memcpy(a, matrix, sizeof a);
    EACH2(i, P, j, P) out[i][j] = i == j;
    regular(a, &out[0][0], P, P);
}
static void covariance(double known[M][M + 1], double out[P][P]) {
    double r[P][P], back[P][P];
    int i, j, k;
    EACH2(i, P, j, P) r[i][j] = known[K + i][K + j];
    inverse(r, back);
    EACH2(i, P, j, P) { out[i][j] = 0.0; EACH(k, P) out[i][j] += back[i][k] * back[j][k]; }
}
static int swept(double table[P][P + 1], const double size[P], int order[P], double increment[P]) {
    double left[P][P + 1];
    int i, j, k, count = 0, taken[P] = {0};
    memcpy(left, table, sizeof left);
    while (count < P) {
        double most = -1.0, share[P], row[P + 1];
        int best = -1;
        EACH(k, P)
            if (!taken[k] && left[k][k] > WITHIN * size[k] && left[k][P] * left[k][P] > most * left[k][k]) {
                best = k; most = left[k][P] * left[k][P] / left[k][k];
            }
        if (best < 0) break;
        taken[best] = 1; order[count] = best; increment[count++] = most; EACH(i, P) share[i] = left[i][best];
        EACH(j, P + 1) row[j] = left[best][j] / left[best][best];
        EACH2(i, P, j, P + 1) left[i][j] -= share[i] * row[j];
    }
    return count;
}

/* Changes of the first parameters of an order, where they alone changed; with them the inverse's diagonal. */
static void amounts(double table[P][P + 1], const int order[P], int count, double found[P], double variance[P]) {
    double a[P * P], b[P * (P + 1)];
    int i, j;
    EACH(i, P) found[i] = variance[i] = 0.0;
    EACH(i, count) {
        EACH(j, count) { a[i * count + j] = table[order[i]][order[j]]; b[i * (count + 1) + 1 + j] = i == j; }
        b[i * (count + 1)] = table[order[i]][P];
    }
    if (count) regular(a, b, count, count + 1);
    EACH(i, count) { found[order[i]] = b[i * (count + 1)]; variance[order[i]] = b[i * (count + 1) + 1 + i]; }
}
static int fewest(int count, const double increment[P]) {
    double left = 0.0;
    int i, named = 0;
    EACH(i, count) left += increment[i];
    while (named < count && left > FURTHER[count - named - 1]) left -= increment[named++];
    return named;
}

typedef struct {
    double statistic, table[P][P + 1], before[P][P + 1], increment[P];
    int columns, order[P];
} change;
static double likelihood_ratio(double statistic, double freedom) { return freedom * log1p(statistic / freedom); }
static double deviate(double ratio, double above, double below, double spread) {
    double root = cbrt(ratio), blocks = below / @GUARD@_BLOCK, a = spread / (9.0 * above), b = spread / (9.0 * below), normal;
    if (below == 0.0 || 2.0 * fmin(above, below) < spread) return 0.0;
    normal = ((1.0 - b) * root - (1.0 - a)) / sqrt(b * root * root + a);
    return copysign(sqrt(likelihood_ratio(normal * normal, blocks)), normal);
}
static void change_of(double known[M][M + 1], double gram[M + 1][M + 1], change *found) {
    double both[M * M], wanted[M * (P + 1)], size[M], diagonal[P], sum;
    int i, j, k;
    EACH2(i, M, j, M + 1) {
        sum = gram[i][j]; EACH(k, M) sum += known[k][i] * known[k][j];
        if (j < M) both[i * M + j] = sum;
        else wanted[i * (P + 1)] = sum;
    }
    EACH(i, M) size[i] = sqrt(fmax(both[i * M + i], 2.2250738585072014e-308));
    EACH(i, M) {
        EACH(j, M) both[i * M + j] /= size[i] * size[j];
        EACH(j, P) wanted[i * (P + 1) + 1 + j] = gram[i][K + j];
        EACH(j, P + 1) wanted[i * (P + 1) + j] /= size[i];
    }
    regular(both, wanted, M, P + 1); EACH2(i, M, j, P + 1) wanted[i * (P + 1) + j] /= size[i];
    EACH(i, P) {
        diagonal[i] = gram[K + i][K + i];
        EACH(j, P + 1) {
            sum = j < P ? gram[K + i][K + j] : gram[K + i][M]; found->before[i][j] = wanted[(K + i) * (P + 1) + j];
            EACH(k, M) sum -= gram[K + i][k] * wanted[k * (P + 1) + (j < P ? 1 + j : 0)];
            found->table[i][j] = sum;
        }
    }
    found->columns = swept(found->table, diagonal, found->order, found->increment); found->statistic = 0.0;
    EACH(i, found->columns) found->statistic += found->increment[i];
}

/* Variance of the noise, its degrees of freedom, its spread. */
static void noise_of(const tracker *t, double out[3]) {
    const double *noise = t->noise;
    double variance = noise[0] / noise[1];
    double between = (noise[4] / noise[1] / (variance * variance) - 1.0) * noise[1] / noise[5];
    out[0] = variance; out[1] = noise[1];
    out[2] = fmax(fmax(NORMAL - 1.0, noise[2] / noise[3] / (variance * variance) - 1.0), between);
}

/* The deviate of a segment's noise; whether a change of the parameters is certain. */
static double tested(tracker *t, int level, change *found, int *certain) {
    const double *meta = t->ladder_meta[level];
    double own = fmax(1.0, meta[1] / meta[2] / (t->noise[0] / t->noise[1]));
    change_of(t->ladder_known[level], t->ladder_gram[level], found);
    *certain = found->columns > 0 &&
               likelihood_ratio(found->statistic / own, t->noise[1]) > CHANGE[PARTS + level][found->columns - 1];
    return deviate(meta[1] / meta[2] / meta[3], meta[2], meta[4], meta[5]);
}

/* Whether a change is certain in a segment within a block. */
static int seen(tracker *t, const real sum[WHOLE], int level) {
    double gram[M + 1][M + 1], noise[3], length = 1L << level;
    change found;
    int i, j;
    for (i = K; i < M && !(sum[AT(i, M)] * sum[AT(i, M)] > t->limit[level] * sum[AT(i, i)]); i++) continue;
    if (i == M && !(sum[AT(M, M)] > t->louder[level])) return 0;
    noise_of(t, noise); EACH2(i, M + 1, j, M + 1) gram[i][j] = sum[i <= j ? AT(i, j) : AT(j, i)] / noise[0];
    change_of(t->known, gram, &found);
    found.statistic = likelihood_ratio(found.statistic * (NORMAL - 1.0) / noise[2], noise[1]);
    return (found.columns > 0 && found.statistic > CHANGE[level][found.columns - 1]) ||
           deviate(gram[M][M] / length, length, noise[1], noise[2]) > NOISE[level];
}

/* ---- what is known ---- */
static double now(const tracker *t) { return t->clock[0] + t->clock[2] * INTERVAL; }
static void drop(double known[M][M + 1]) { memset(known, 0, K * (M + 1) * sizeof(double)); }
static void next_block(tracker *t) { memset(t->own, 0, sizeof t->own); memset(t->part, 0, sizeof t->part); }
static void drop_block(tracker *t) { next_block(t); t->clock[5] = 0.0; }
static void free_run(tracker *t) {
    int i;
    memset(t->cell, 0, sizeof t->cell); t->cell[2 * (1 + P)] = t->cell[2 * (1 + P) + 3] = 1;
    memset(t->rows, 0, sizeof t->rows); drop_block(t);
    EACH(i, K) t->point[i] = 0.0;
    drop(t->known); drop(t->before);
    EACH(i, LEVELS) {
        drop(t->ladder_known[i]);
        if (t->ladder_meta[i][0] > 0.0) without_nuisances(t->ladder_gram[i]);
    }
    t->clock[6] = 1.0;
}
static void walked(const tracker *t, double known[M][M + 1]) {
    double variance[P], past = fmax(0.0, now(t) - t->clock[3]);
    int p;
    memcpy(known, t->known, sizeof t->known);
    EACH(p, P) variance[p] = DRIFT_RATE * past * (WALKS[p] ? t->point[K + p] * t->point[K + p] : 1.0);
    walk(known, variance);
}
static void shift_known(double known[M][M + 1], const double move[M]) {
    int i, j;
    EACH2(i, M, j, M) known[i][M] -= known[i][j] * move[j];
}
static double within(const tracker *t, int i, double move) {
    if (POSITIVE[i]) move = fmin(fmax(move, (1.0 / FURTHEST - 1.0) * t->point[K + i]), (FURTHEST - 1.0) * t->point[K + i]);
    return move;
}
static void move_point(tracker *t, double move[M]) {
    double (*row)[M + 1] = (double (*)[M + 1])(void *)t->row;
    int i, j, level;
    EACH(i, P) move[K + i] = within(t, i, move[K + i]);
    for (i = N; i < M; i++) t->point[i] += move[i];
    EACH(j, N) {
        double sum = 0.0;
        EACH(i, N) sum += move[i] * t->cell[2 * (1 + P + i) + j];
        EACH(i, P) sum += move[K + i] * t->cell[2 * (1 + i) + j];
        t->cell[j] += (real)sum;
    }
    shift_known(t->known, move); shift_known(t->before, move);
    EACH(i, AR) {
        double sum = 0.0;
        EACH(j, M) sum += t->rows[i][j] * move[j];
        t->rows[i][M] -= (real)sum;
    }
    EACH(level, LEVELS) { shift_known(t->ladder_known[level], move); shift(t->ladder_gram[level], move); }
    shift(row, move); linearise(t);
}
static void say(tracker *t, int parameter, double before, double after, double u, int passed) {
    @N@_alarm *alarm = &t->alarm[t->alarms < @GUARD@_ALARMS ? t->alarms++ : @GUARD@_ALARMS - 1];
    alarm->parameter = parameter; alarm->passed = passed; alarm->time_s = t->pending[1];
    alarm->detected_s = t->pending[2]; alarm->before = before; alarm->after = after; alarm->u = u;
}
static void say_noise(tracker *t, double now, double freedom, int passed) {
    const double *p = t->pending;
    say(t, P, sqrt(p[3]), sqrt(now), sqrt(p[5] / 4.0 * (p[3] / p[4] + now / freedom)), passed);
}

/* Open parameters that changed by so much to what follows. */
static void open(tracker *t, double known[M][M + 1], const double amount[P], double move[M]) {
    double variance[P];
    int p;
    memmove(t->known, known, sizeof t->known);
    EACH(p, P) variance[p] = amount[p] * amount[p] / LEFT;
    walk(t->known, variance); memset(t->noise, 0, sizeof t->noise); memset(t->lags, 0, sizeof t->lags);
    move_point(t, move);
}
static void relearn(tracker *t, int certain) {
    double move[M] = {0}, amount[P], unused[P], most = -HUGE_VAL;
    change found, best;
    const double *meta;
    int level, chosen = 0, p, j, ignored;
    memset(&best, 0, sizeof best);
    EACH(level, LEVELS)
        if (t->ladder_meta[level][0] > 0.0) {
            double value = tested(t, level, &found, &ignored);
            if (certain) value = found.statistic;
            if (value > most) { chosen = level; most = value; best = found; }
        }
    meta = t->ladder_meta[chosen];
    if (t->pending[0] != SEEN) {
        t->pending[1] = meta[6]; t->pending[2] = now(t); memcpy(t->pending + 3, meta + 3, 3 * sizeof(double));
        t->pending[6] = meta[0];
    }
    t->pending[0] = OPENED; memcpy(t->before, t->ladder_known[chosen], sizeof t->before);
    amounts(best.table, best.order, fewest(best.columns, best.increment), amount, unused);
    EACH(p, P) {
        move[K + p] = best.before[p][0] + amount[p]; EACH(j, P) move[K + p] -= best.before[p][1 + j] * amount[j];
    }
    memset(t->ladder_meta, 0, sizeof t->ladder_meta); t->clock[4] = t->clock[9] = t->clock[10] = 0.0;
    open(t, t->before, amount, move);
}

/* Forget every parameter: the parts of a run contradict what was known, each in its own way. */
static void contradict(tracker *t) {
    double amount[P], back[M], move[M] = {0.0};
    int p;
    solve(t->known, back);
    t->pending[0] = OPENED; t->pending[2] = now(t); t->pending[6] = 1.0;
    t->pending[3] = t->pending[4] = t->pending[5] = 0.0;
    memcpy(t->before, t->known, sizeof t->before);
    EACH(p, P) { amount[p] = 1.0; move[K + p] = back[K + p]; }
    memset(t->ladder_meta, 0, sizeof t->ladder_meta); t->clock[4] = t->clock[9] = t->clock[10] = 0.0;
    open(t, t->before, amount, move);
}
static int alarmed(tracker *t) {
    long blocks = (long)t->clock[4];
    int level;
    for (level = 0; level < LEVELS && blocks % (1L << level) == 0; level++) {
        change found;
        int certain;
        double noisier = tested(t, level, &found, &certain);
        if (certain || noisier > NOISE[PARTS + level]) { relearn(t, certain); return 1; }
    }
    if (t->pending[0] == SEEN) {
        say_noise(t, t->ladder_meta[0][1] / t->ladder_meta[0][2], t->ladder_meta[0][2], 1); t->pending[0] = 0.0;
    }
    return 0;
}
static void name_change(tracker *t) {
    double before[M], after[M], one[P][P], two[P][P], table[P][P + 1], increment[P], amount[P], variance[P];
    double now_it_is = t->noise[0] / t->noise[1], freedom = t->noise[1], diagonal[P];
    int i, j, named, louder, dead = 0, order[P];
    solve(t->before, before); solve(t->known, after); covariance(t->before, one); covariance(t->known, two);
    EACH2(i, P, j, P) one[i][j] += two[i][j];
    inverse(one, two);
    EACH(i, P) {
        table[i][P] = 0.0; diagonal[i] = two[i][i];
        EACH(j, P) { table[i][j] = two[i][j]; table[i][P] += two[i][j] * (after[K + j] - before[K + j]); }
    }
    named = fewest(swept(table, diagonal, order, increment), increment);
    louder = deviate(now_it_is / t->pending[3], freedom, t->pending[4], t->pending[5]) > NOISE[PARTS];
    if (!named && !louder && t->pending[6] > 1.0) { t->pending[6] -= 1.0; return; }
    amounts(table, order, named, amount, variance);
    EACH(i, named) {
        int p = order[i];
        double value = (t->point[K + p] + before[K + p]) * SCALE[p], u = sqrt(variance[p]) * SCALE[p];
        double to = value + amount[p] * SCALE[p];
        say(t, p, value, to, u, 0);
        if (p == 0 && fabs(to) < 3.0 * u) { /* a dead channel: it tells the gain alone */
            double step[P] = {0};
            step[0] = after[K] - before[K]; before[K] = after[K]; open(t, t->before, step, before);
            EACH(j, M) t->known[j][M] = 0.0;
            dead = 1; break;
        }
    }
    if (!dead && t->pending[4] > 0.0) {
        if (louder) say_noise(t, now_it_is, freedom, 0);
        else if (!named) {
            say_noise(t, now_it_is, freedom, 1); memcpy(t->known, t->before, sizeof t->known); free_run(t);
        }
    }
    t->pending[0] = t->clock[4] = 0.0;
}

/* ---- learning from a block ---- */
static void whiten(tracker *t) {
    int i;
    t->whitens = 0;
    EACH(i, AR) if ((t->white[i] = (real)t->whitening[i]) != 0) t->whitens = i + 1;
}
static void learn_whitening(tracker *t, const double lags[AR + 1], double rows) {
    double r[AR + 1], a[AR] = {0}, next[AR], left, least = 0.0, kept = 0.0, count;
    long blocks;
    int i, order;
    t->lags[0] += rows; t->lags[1] += 1.0; EACH(i, AR + 1) t->lags[2 + i] += lags[i]; blocks = (long)t->lags[1];
    if (blocks & (blocks - 1)) return;
    count = t->lags[0]; EACH(i, AR + 1) r[i] = t->lags[2 + i] / count; left = kept = r[0];
    memset(t->whitening, 0, sizeof t->whitening);
    for (order = 1; order <= AR; order++) {
        double sum = r[order], reflection, criterion;
        EACH(i, order - 1) sum += a[i] * r[order - 1 - i];
        reflection = -sum / left;
        if (!(reflection * reflection < 1.0)) break;
        EACH(i, order - 1) next[i] = a[i] + reflection * a[order - 2 - i];
        next[order - 1] = reflection; memcpy(a, next, (unsigned)order * sizeof(double));
        left *= 1.0 - reflection * reflection; criterion = count * log(left / r[0]) + order * log(count);
        if (criterion < least) { least = criterion; kept = left; memcpy(t->whitening, a, sizeof t->whitening); }
    }
    if (t->noise[1] > 0.0) {
        double ratio = kept / (t->noise[0] / t->noise[1]);
        t->noise[0] *= ratio; t->noise[2] *= ratio * ratio; t->noise[4] *= ratio * ratio;
    }
    whiten(t);
}
static double distance(double known[M][M + 1], const double move[M]) {
    double sum = 0.0;
    int i, j;
    for (i = K; i < M; i++) {
        double away = 0.0;
        for (j = i; j < M; j++) away += known[i][j] * move[j];
        sum += away * away;
    }
    return sum;
}
static int moved(tracker *t, int fresh) {
    double move[M];
    solve(t->known, move);
    if (!fresh && t->clock[4] > 1.0 && distance(t->known, move) <= P) return 0;
    move_point(t, move); return 1;
}
static void ladder_add(tracker *t, double gram[M + 1][M + 1], double squares, double freedom, const double before[3],
                       double start) {
    long blocks = (long)t->clock[4];
    int level, i, j;
    EACH(level, LEVELS) {
        double *meta = t->ladder_meta[level];
        if (blocks % (1L << level) == 0) {
            memcpy(t->ladder_known[level], t->known, sizeof t->known);
            memset(t->ladder_gram[level], 0, sizeof t->ladder_gram[level]); meta[0] = meta[1] = meta[2] = 0.0;
            memcpy(meta + 3, before, 3 * sizeof(double)); meta[6] = start;
        }
        EACH2(i, M + 1, j, M + 1) t->ladder_gram[level][i][j] += gram[i][j];
        meta[0] += 1.0; meta[1] += squares; meta[2] += freedom;
    }
}
static void end_block(tracker *t) {
    double gram[M + 1][M + 1], upper[M + 1][M + 1], learned[M][M + 1], lags[AR + 1], before[3] = {0.0, 0.0, 0.0};
    double move[M], squares, freedom, variance, least, rows = t->own[1], fourth = t->own[2];
    double start = now(t) - t->own[0] * INTERVAL;
    int i, j, k, fresh;
    memset(gram, 0, sizeof gram);
    EACH(k, PARTS + 1)
        if ((int)rows >> k & 1) EACH2(i, M + 1, j, M + 1) gram[i][j] += t->part[k][i <= j ? AT(i, j) : AT(j, i)];
    for (i = 0; i < 2 * (3 + P); i++)
        if (fabs((double)t->cell[i]) < (sizeof(real) < sizeof(double) ? 1e-30 : 1e-150)) t->cell[i] = 0;
    triangle(gram, upper); squares = upper[M][M] * upper[M][M]; freedom = rows;
    EACH(i, M) freedom -= upper[i][i] != 0.0;
    variance = t->noise[1] > 0.0 ? t->noise[0] / t->noise[1] : squares / fmax(freedom, 1.0);
    least = fmax(upper[K][K], 1e-150); least = EXCITED * rows * variance / (least * least);
    if (!(freedom > 0.0 && variance > 0.0 && fmax(1.0, t->point[K] * t->point[K]) > least)) {
        free_run(t); return;
    }
    if (t->point[K] * t->point[K] <= least) {
        for (i = K + 1; i < M; i++) EACH(j, M + 1) gram[i][j] = gram[j][i] = 0.0;
        triangle(gram, upper);
    }
    fresh = t->clock[6] != 0.0;
    if (fresh)
        EACH(i, K) t->known[i][i] = sqrt(NONE * fmax(gram[i][i], TINY) / variance);
    t->clock[6] = 0.0; walked(t, learned); memcpy(t->known, learned, sizeof learned); t->clock[3] = now(t);
    absorb(learned, upper, 1.0 / sqrt(variance)); memcpy(lags, t->own + 3, sizeof lags);
    if (t->clock[9] == 0.0) {
        if (t->pending[0] != OPENED) {
            if (t->clock[10] == 0.0) t->pending[1] = now(t) - t->own[0] * INTERVAL;
            t->clock[10] += 1.0;
        }
        solve(learned, move);
        if (!fresh && distance(learned, move) <= 2.0 * FURTHER[P - 1]) {
            t->clock[9] = 1.0; learn_whitening(t, lags, rows); memset(t->lags, 0, sizeof t->lags);
        }
        next_block(t); move_point(t, move);
        return;
    }
    if (t->noise[1] > 0.0) noise_of(t, before);
    EACH2(i, M + 1, j, M + 1) { gram[i][j] /= variance; t->row[i * (M + 1) + j] += gram[i][j]; }
    if (t->pending[0] != OPENED) ladder_add(t, gram, squares, freedom, before, start);
    memcpy(t->known, learned, sizeof learned); t->row[(M + 1) * (M + 1)] += squares;
    t->row[(M + 1) * (M + 1) + 1] += freedom; t->noise[0] += squares; t->noise[1] += freedom; t->noise[2] += fourth;
    t->noise[3] += rows; t->noise[4] += squares * squares / freedom; t->noise[5] += 1.0; t->clock[4] += 1.0;
    next_block(t);
    if (t->pending[0] == OPENED) name_change(t);
    else if (alarmed(t)) return;
    if (!moved(t, fresh)) learn_whitening(t, lags, rows);
}

/* ---- samples ---- */
/* What holds for a block: whether it is tested sample by sample, and from which squares on. */
static void prepare(tracker *t) {
    double noise[3];
    int i;
    t->tests = t->clock[9] != 0.0 && t->clock[6] == 0.0 && t->pending[0] == 0.0 && t->noise[1] > 0.0 ? PARTS : 0;
    if (!t->tests) return;
    noise_of(t, noise);
    EACH(i, PARTS) {
        t->limit[i] = (real)(CHANGE[i][0] * noise[0] * noise[2] / (NORMAL - 1.0));
        t->louder[i] = (real)(noise[0] * LOUDER[i]);
        t->least[i] = t->limit[i] < t->louder[i] ? t->limit[i] : t->louder[i];
    }
}

/* A row into the segments of the block, the digits of a binary counter; the level of one that is certain, or -1. */
static int count_row(tracker *t, const real white[M + 1]) {
    real sum[WHOLE];
    int i, j, level, count = (int)t->own[1], certain = -1;
    EACH(i, M + 1) for (j = i; j <= M; j++) sum[AT(i, j)] = white[i] * white[j];
    for (level = 0;; level++) {
        if (level < t->tests && sum[WHOLE - 1] > t->least[level] && certain < 0 && seen(t, sum, level)) certain = level;
        if (!(count >> level & 1)) break;
        EACH(i, WHOLE) sum[i] += t->part[level][i];
    }
    memcpy(t->part[level], sum, sizeof sum);
    return certain;
}
static void begin_change(tracker *t, long length) {
    t->pending[0] = SEEN; t->pending[2] = now(t); t->pending[1] = now(t) - (double)length * INTERVAL;
    noise_of(t, t->pending + 3); t->pending[6] = 1.0; memset(t->ladder_meta, 0, sizeof t->ladder_meta);
    t->clock[4] = 0.0; drop_block(t);
}

/* One step of the network: its row, whitened, into the block. */
static void take(tracker *t, const real *reference, real response) {
    real input[Q] = {0}, row[M + 1], white[M + 1], x[2], y;
    int i, j, k, p, certain = -1;
    if (t->own[0] == 0.0) prepare(t);
    EACH2(i, TAPS, j, Q) input[j] += FILTER[i][j] * reference[i];
    x[0] = t->cell[0]; x[1] = t->cell[1]; y = t->c[0] * x[0] + t->c[1] * x[1]; EACH(j, Q) y += t->d[j] * input[j];
    EACH(i, N) {
        real *m = t->cell + 2 * (1 + P + i), first = m[0];
        row[i] = t->c[0] * m[0] + t->c[1] * m[1]; m[0] = t->phi[0][0] * first + t->phi[0][1] * m[1];
        m[1] = t->phi[1][0] * first + t->phi[1][1] * m[1];
    }
    row[N] = 1;
    EACH(p, P) {
        real *s = t->cell + 2 * (1 + p), next[2];
        row[K + p] = t->c[0] * s[0] + t->c[1] * s[1] + t->d_c[p][0] * x[0] + t->d_c[p][1] * x[1];
        EACH(j, Q) row[K + p] += t->d_d[p][j] * input[j];
        EACH(k, 2) {
            next[k] = t->phi[k][0] * s[0] + t->phi[k][1] * s[1] + t->d_phi[p][k][0] * x[0] + t->d_phi[p][k][1] * x[1];
            EACH(j, Q) next[k] += t->d_gamma[p][k][j] * input[j];
        }
        s[0] = next[0]; s[1] = next[1];
    }
    EACH(k, 2) {
        t->cell[k] = t->phi[k][0] * x[0] + t->phi[k][1] * x[1]; EACH(j, Q) t->cell[k] += t->gamma[k][j] * input[j];
    }
    row[M] = response - y - (real)t->point[N]; memcpy(white, row, sizeof white);
    EACH2(k, t->whitens, i, M + 1) white[i] += t->white[k] * t->rows[(t->row_next + AR - 1 - k) % AR][i];
    if (t->clock[5] >= AR) {
        double e = white[M];
        certain = count_row(t, white); t->own[1] += 1.0; t->own[2] += e * e * e * e; t->own[3] += row[M] * row[M];
        EACH(k, AR) t->own[4 + k] += row[M] * t->rows[(t->row_next + AR - 1 - k) % AR][M];
    } else
        t->clock[5] += 1.0;
    memcpy(t->rows[t->row_next], row, sizeof row); t->row_next = (t->row_next + 1) % AR;
    t->own[0] += 1.0; t->clock[2] += 1.0;
    if (certain >= 0) begin_change(t, 1L << certain);
    else if (t->own[0] >= (t->clock[9] != 0.0 ? @GUARD@_BLOCK : @GUARD@_BLOCK / @FIRST_PART@)) end_block(t);
}
static void put(real *ring, int size, int *next, int *count, real sample) {
    ring[*next] = ring[*next + size] = sample; *next = *next + 1 < size ? *next + 1 : 0; ++*count;
}

/* The oldest of those that wait. */
static const real *oldest(const real *ring, int size, int next, int count) {
    int at = next - count; return ring + (at < 0 ? at + size : at);
}
/* Ends a run of samples. */
static void end_run(tracker *t) {
    if (t->own[1] > 0.0) end_block(t);
    if (t->clock[9] == 0.0 && t->clock[10] > @FIRST_PART@.0) contradict(t);
}
int @N@_changing(const tracker *t) { return t->pending[0] != 0.0; }
void @N@_finish(tracker *t) { end_run(t); }
void @N@_begin(tracker *t, double time_s) {
    end_run(t);
    if (isnan(t->clock[3]) || (t->clock[1] == 0.0 && t->clock[3] == t->clock[0])) t->clock[3] = time_s;
    t->references = t->responses = 0; t->clock[0] = time_s; t->clock[1] = t->clock[10] = 0.0;
    t->clock[2] = t->clock[8] = FIRST < 0 ? -FIRST : 0; t->clock[7] = FIRST > 0 ? FIRST : 0;
    free_run(t);
}
void @N@_init(tracker *t) {
    int i, j;
    memset(t, 0, sizeof *t);
    EACH(i, P) { t->point[K + i] = START[i] / SCALE[i]; EACH(j, P) t->known[K + i][K + j] = PRIOR[i][j]; }
    t->clock[3] = NAN; t->clock[6] = 1.0; @N@_begin(t, 0.0); linearise(t);
}
int @N@_step(tracker *t, real reference, real response) {
    if (!isfinite(reference) || !isfinite(response)) {
        @N@_begin(t, t->clock[0] + (t->clock[1] + 1.0) * INTERVAL); return t->alarms;
    }
    t->clock[1] += 1.0; if (t->clock[7] > 0.0) t->clock[7] -= 1.0;
    else put(t->reference, @GUARD@_REFERENCES, &t->reference_next, &t->references, reference);
    if (t->clock[8] > 0.0) t->clock[8] -= 1.0;
    else put(t->response, @GUARD@_RESPONSES, &t->response_next, &t->responses, response);
    if (t->references >= TAPS && t->responses > 0) {
        take(t, oldest(t->reference, @GUARD@_REFERENCES, t->reference_next, t->references),
        *oldest(t->response, @GUARD@_RESPONSES, t->response_next, t->responses)); t->references--;
        t->responses--;
    }
    return t->alarms;
}
double @N@_read(tracker *t, double value[P], double u[P], int excited[P]) {
    double known[M][M + 1], move[M], spread[P][P], upper[M + 1][M + 1], r[P][P], back[P][P], rms = -1.0;
    double (*row)[M + 1] = (double (*)[M + 1])(void *)t->row;
    int i, j, all = 1;
    walked(t, known); solve(known, move); covariance(known, spread); without_nuisances(row); triangle(row, upper);
    EACH(i, P) {
        value[i] = (t->point[K + i] + within(t, i, move[K + i])) * SCALE[i]; u[i] = sqrt(spread[i][i]) * SCALE[i]; excited[i] = 0;
        all = all && upper[K + i][K + i] > 0.0; EACH(j, P) r[i][j] = upper[K + i][K + j];
    }
    u[0] = sqrt(u[0] * u[0] + REFERENCE_U * value[0] * REFERENCE_U * value[0]);
    if (all) {
        inverse(r, back);
        EACH(i, P) {
            double alone = 0.0, together = 0.0, size = value[i] / SCALE[i];
            EACH(j, P) { alone += back[i][j] * back[i][j]; together += r[j][i] * r[j][i]; }
            alone = 1.0 / alone; excited[i] = alone > ALONE * together && alone * size * size > 1.0;
        }
    }
    i = (M + 1) * (M + 1); if (t->row[i + 1] > 0.0) rms = sqrt(t->row[i] / t->row[i + 1]);
    memset(t->row, 0, sizeof t->row); return rms;
}

real @N@_correct(tracker *t, real response) {
    const real *line;
    real sum = 0;
    int i, k;
    t->line[t->line_next] = t->line[t->line_next + @GUARD@_CORRECTOR_TAPS] = response;
    t->line_next = t->line_next + 1 < @GUARD@_CORRECTOR_TAPS ? t->line_next + 1 : 0; line = t->line + t->line_next;
    EACH(k, 3) {
        real part = 0;
        EACH(i, @GUARD@_CORRECTOR_TAPS) part += CORRECTOR[k][i] * line[i];
        sum += t->coefficient[k] * part;
    }
    return sum;
}

/* ---- bytes ---- */
static unsigned long crc32(const unsigned char *bytes, unsigned long size) {
    unsigned long crc = 0xFFFFFFFFUL, i;
    int bit;
    EACH(i, size) { crc ^= bytes[i]; EACH(bit, 8) crc = (crc >> 1) ^ (0xEDB88320UL & (0UL - (crc & 1UL))); }
    return crc ^ 0xFFFFFFFFUL;
}
static void put32(unsigned char *bytes, unsigned long value) {
    bytes[0] = value & 255UL; bytes[1] = value >> 8 & 255UL; bytes[2] = value >> 16 & 255UL; bytes[3] = value >> 24 & 255UL;
}
static unsigned long get32(const unsigned char *bytes) {
    return bytes[0] | (unsigned long)bytes[1] << 8 | (unsigned long)bytes[2] << 16 | (unsigned long)bytes[3] << 24;
}

/* Numbers in the order of the state; to the bytes, or from them. */
typedef struct {
    unsigned char *bytes;
    unsigned long at;
    int restoring;
} stream;
static double number(stream *s, double value) {
    unsigned char *place = s->bytes + s->at;
    unsigned long long bits = 0;
    int i;
    s->at += 8;
    if (s->restoring) {
        EACH(i, 8) bits |= (unsigned long long)place[i] << (8 * i);
        memcpy(&value, &bits, 8); return value;
    }
    memcpy(&bits, &value, 8); EACH(i, 8) place[i] = (unsigned char)(bits >> (8 * i) & 255ULL); return value;
}
static void reals(stream *s, real *values, int count) {
    int i;
    EACH(i, count) values[i] = (real)number(s, values[i]);
}
static void state(stream *s, tracker *t) {
    int i, j, k;
    double *each = (double *)(void *)t; /* the struct begins with all that is double, in the order of the state */
    EACH(i, (int)(offsetof(tracker, cell) / sizeof(double))) each[i] = number(s, each[i]);
    reals(s, t->cell, @GUARD@_CELL); EACH(k, AR) reals(s, t->rows[(t->row_next + k) % AR], M + 1);
    EACH(k, PARTS + 1) EACH2(i, M + 1, j, M + 1) {
        real *part = &t->part[k][i <= j ? AT(i, j) : AT(j, i)];
        *part = (real)number(s, (int)t->own[1] >> k & 1 || s->restoring ? *part : 0.0);
    }
}
unsigned long @N@_save(const tracker *t, unsigned char *bytes) {
    stream s;
    int i;
    s.bytes = bytes; s.at = 16; s.restoring = 0; memcpy(bytes, "VTR2", 4); state(&s, (tracker *)t);
    put32(bytes + 4, (s.at - 16) / 8); put32(bytes + 8, (unsigned long)t->references);
    put32(bytes + 12, (unsigned long)t->responses);
    EACH(i, t->references) number(&s, oldest(t->reference, @GUARD@_REFERENCES, t->reference_next, t->references)[i]);
    EACH(i, t->responses) number(&s, oldest(t->response, @GUARD@_RESPONSES, t->response_next, t->responses)[i]);
    put32(bytes + s.at, crc32(bytes, s.at)); return s.at + 4;
}
int @N@_restore(tracker *t, const unsigned char *bytes, unsigned long size) {
    stream s;
    unsigned long references, responses, i;
    if (size < 20 || memcmp(bytes, "VTR2", 4) != 0 || get32(bytes + 4) != @NUMBERS@) return 0;
    references = get32(bytes + 8); responses = get32(bytes + 12);
    if (references > @GUARD@_REFERENCES || responses > @GUARD@_RESPONSES ||
        size != 20 + 8 * (@NUMBERS@ + references + responses) || crc32(bytes, size - 4) != get32(bytes + size - 4))
    return 0;
    s.bytes = (unsigned char *)bytes; s.at = 16; s.restoring = 1; t->row_next = 0; state(&s, t);
    t->references = t->responses = t->reference_next = t->response_next = 0;
    EACH(i, references)
        put(t->reference, @GUARD@_REFERENCES, &t->reference_next, &t->references, (real)number(&s, 0.0));
    EACH(i, responses) put(t->response, @GUARD@_RESPONSES, &t->response_next, &t->responses, (real)number(&s, 0.0));
    whiten(t); linearise(t); prepare(t); return 1;
}
