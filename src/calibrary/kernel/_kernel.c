/* The geometry of the lens models in C, for CPython's limited API: no NumPy headers, one binary for Python 3.11 and later.

   A camera is a plan of SIZE doubles, which kernel/__init__.py fills in. All models are one chain:

       ray -> front: perspective, polynomial of the angle, unified, EUCM, double sphere, division
           -> plane: none, radial, Brown, or all terms of calibrary.distortion.polynomial and brown_polynomial
           -> K -> pixel

   The formulas and their sources stand with the models in calibrary.distortion, whose NumPy is the reference. A point that
   is not certainly inside the valid field, or whose inverse has not converged well, becomes NaN and is counted: the caller
   leaves it to the reference. Points go in blocks of plain arrays, which compilers turn into vector instructions; the order
   of the operations is the reference's, and compiled without contraction the projection by Brown's model is bit-equal. */
#define PY_SSIZE_T_CLEAN
#define Py_LIMITED_API 0x030b0000
#include <Python.h>
#include <math.h>
#include <stddef.h>

#if defined(__x86_64__) && defined(__gnu_linux__) && !defined(__clang__)
#define CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define CLONES
#endif
#ifdef _MSC_VER
#define INLINE static __forceinline
#else
#define INLINE static inline __attribute__((always_inline))
#endif

enum { LAYOUT = 1, SIZE = 40, BLOCK = 64, NEWTON_STEPS = 8, ANGLE_STEPS = 12 };
enum {
    FRONT, PLANE, FX, FY, CX, CY, SKEW, SQUARE, LIMIT, /* SQUARE: of the plane's valid radius; LIMIT: of the angle, rad */
    N1, D1 = N1 + 6, P1 = D1 + 3, P2, S1, S2, S3, S4, T2, T4, B1, B2, F1, START = F1 + 6
};
enum { PERSPECTIVE, ANGLE, UNIFIED, EUCM, DOUBLE_SPHERE, DIVISION };
enum { NONE, RADIAL, BROWN, GENERAL };
#define SETTLED 1e-18         /* squares of the reference's relative steps */
#define WELL_CONDITIONED 0.05 /* as in the reference */
#define CANCELLED 1e-4        /* share of its terms that a divisor may be: less is left to the reference, which is exact */
#define FAR 1e8               /* square in the plane from which a sphere's rays lie too close to tell by subtraction */
#define TINY 1e-280           /* squares of lengths that neither vanish nor overflow */
#define HUGE_SQUARE 1e280

typedef const double *Plan;

INLINE double numerator(int plane, Plan p, double s) {
    if (plane != GENERAL) return ((s * p[N1 + 2] + p[N1 + 1]) * s + p[N1]) * s + 1.0;
    return (((((s * p[N1 + 5] + p[N1 + 4]) * s + p[N1 + 3]) * s + p[N1 + 2]) * s + p[N1 + 1]) * s + p[N1]) * s + 1.0;
}

INLINE double numerator_slope(int plane, Plan p, double s) {
    if (plane != GENERAL) return (s * (3.0 * p[N1 + 2]) + 2.0 * p[N1 + 1]) * s + p[N1];
    return ((((s * (6.0 * p[N1 + 5]) + 5.0 * p[N1 + 4]) * s + 4.0 * p[N1 + 3]) * s + 3.0 * p[N1 + 2]) * s
            + 2.0 * p[N1 + 1]) * s + p[N1];
}

INLINE void plane_image(int plane, Plan p, double x, double y, double *u, double *v) {
    if (plane == NONE) {
        *u = x; *v = y;
        return;
    }
    double s = x * x + y * y, gain = numerator(plane, p, s);
    if (plane == GENERAL) gain /= ((s * p[D1 + 2] + p[D1 + 1]) * s + p[D1]) * s + 1.0;
    if (plane == RADIAL) {
        *u = x * gain; *v = y * gain;
        return;
    }
    if (plane == BROWN) {
        gain = gain + (2.0 * p[P2]) * x + (2.0 * p[P1]) * y;
        *u = x * gain + p[P2] * s; *v = y * gain + p[P1] * s;
        return;
    }
    double across = 2.0 * (p[P2] * x + p[P1] * y), growth = 1.0 + s * (p[T2] + p[T4] * s);
    *u = x * gain + (x * across + p[P2] * s) * growth + s * (p[S1] + p[S2] * s) + (p[B1] * x + p[B2] * y);
    *v = y * gain + (y * across + p[P1] * s) * growth + s * (p[S3] + p[S4] * s);
}

/* The image with its derivatives ux, uy, vx, vy. */
INLINE void plane_jacobian(int plane, Plan p, double x, double y, double *u, double *v, double J[4]) {
    double s = x * x + y * y, x2 = 2.0 * x, y2 = 2.0 * y;
    double gain = numerator(plane, p, s), slope = numerator_slope(plane, p, s);
    if (plane == GENERAL) {
        double divisor = ((s * p[D1 + 2] + p[D1 + 1]) * s + p[D1]) * s + 1.0;
        double divisor_slope = (s * (3.0 * p[D1 + 2]) + 2.0 * p[D1 + 1]) * s + p[D1];
        gain /= divisor;
        slope = (slope - gain * divisor_slope) / divisor;
    }
    double p1 = p[P1], p2 = p[P2];
    if (plane != GENERAL) {
        if (plane == RADIAL) p1 = p2 = 0.0;
        gain = gain + p2 * x2 + p1 * y2;
        double gain_x = slope * x2 + 2.0 * p2, gain_y = slope * y2 + 2.0 * p1;
        *u = x * gain + p2 * s; *v = y * gain + p1 * s;
        J[0] = gain + x * gain_x + p2 * x2; J[1] = x * gain_y + p2 * y2;
        J[2] = y * gain_x + p1 * x2; J[3] = gain + y * gain_y + p1 * y2;
        return;
    }
    double across = 2.0 * (p2 * x + p1 * y), growth = 1.0 + s * (p[T2] + p[T4] * s), growing = p[T2] + 2.0 * p[T4] * s;
    double along_x = x * across + p2 * s, along_y = y * across + p1 * s, mixed = 2.0 * (p1 * x + p2 * y);
    *u = x * gain + along_x * growth + s * (p[S1] + p[S2] * s) + (p[B1] * x + p[B2] * y);
    *v = y * gain + along_y * growth + s * (p[S3] + p[S4] * s);
    double by_s_u = along_x * growing + p[S1] + 2.0 * p[S2] * s, by_s_v = along_y * growing + p[S3] + 2.0 * p[S4] * s;
    J[0] = gain + x * slope * x2 + (6.0 * p2 * x + 2.0 * p1 * y) * growth + by_s_u * x2 + p[B1];
    J[1] = x * slope * y2 + mixed * growth + by_s_u * y2 + p[B2];
    J[2] = y * slope * x2 + mixed * growth + by_s_v * x2;
    J[3] = gain + y * slope * y2 + (6.0 * p1 * y + 2.0 * p2 * x) * growth + by_s_v * y2;
}

INLINE double angle_image(Plan p, double t) {
    double s = t * t;
    return ((((((s * p[F1 + 5] + p[F1 + 4]) * s + p[F1 + 3]) * s + p[F1 + 2]) * s + p[F1 + 1]) * s + p[F1]) * s + 1.0) * t;
}

INLINE double angle_slope(Plan p, double t) {
    double s = t * t;
    return (((((s * (13.0 * p[F1 + 5]) + 11.0 * p[F1 + 4]) * s + 9.0 * p[F1 + 3]) * s + 7.0 * p[F1 + 2]) * s
             + 5.0 * p[F1 + 1]) * s + 3.0 * p[F1]) * s + 1.0;
}

/* atan2(R, Z) for R >= 0, without a branch or a call, so that a loop over it becomes vector instructions: within 1.5 units
   in the last place. The argument is reduced to below tan(π/8) as in Cephes' atan.c (S. L. Moshier), whose coefficients
   these are. */
INLINE double angle_from_axis(double R, double Z) {
    double height = fabs(Z);
    double over = R, under = height, part = 0.0; /* of a right angle */
    over = R > 0.66 * height ? R - height : over;
    under = R > 0.66 * height ? R + height : under;
    part = R > 0.66 * height ? 0.5 : part;
    over = R > 2.41421356237309504880 * height ? -height : over;
    under = R > 2.41421356237309504880 * height ? R : under;
    part = R > 2.41421356237309504880 * height ? 1.0 : part;
    double q = over / under, s = q * q;
    double p = ((((-8.750608600031904122785e-1 * s - 1.615753718733365076637e1) * s - 7.500855792314704667340e1) * s
                 - 1.228866684490136173410e2) * s - 6.485021904942025371773e1) * s;
    p /= ((((s + 2.485846490142306297962e1) * s + 1.650270098316988542046e2) * s + 4.328810604912902668951e2) * s
          + 4.853903996359136964868e2) * s + 1.945506571482613964425e2;
    double angle = part * 1.57079632679489661923 + (q * p + part * 6.123233995736765886130e-17 + q);
    return Z < 0 ? 3.14159265358979323846 - angle : angle;
}

INLINE int front_image(int front, Plan p, double X, double Y, double Z, double *x, double *y) {
    if (front == PERSPECTIVE) {
        *x = X / Z; *y = Y / Z;
        return Z > 0;
    }
    double square = X * X + Y * Y, a = p[F1], b = p[F1 + 1], divisor;
    int seen;
    if (front == ANGLE) {
        double R = sqrt(square), t = angle_from_axis(R, Z), stretch = angle_image(p, t) / (R > 0 ? R : 1.0);
        *x = X * stretch; *y = Y * stretch;
        return (t < p[LIMIT]) & (((square > TINY) & (square < HUGE_SQUARE)) | ((X == 0) & (Y == 0) & (Z > 0)));
    }
    double d = sqrt(square + Z * Z);
    if (front == UNIFIED) {
        divisor = Z + a * d;
        seen = (divisor > CANCELLED * (fabs(Z) + fabs(a) * d)) & (d + a * Z > 0);
    } else if (front == EUCM) {
        d = sqrt(b * square + Z * Z);
        divisor = a * d + (1.0 - a) * Z;
        seen = (divisor > CANCELLED * (d + fabs(Z))) & ((1.0 - a) * d + a * Z > 0);
    } else if (front == DOUBLE_SPHERE) {
        double depth = Z + a * d, e = sqrt(square + depth * depth);
        divisor = b * e + (1.0 - b) * depth;
        seen = (divisor > CANCELLED * (fabs(Z) + fabs(a) * d + e)) & ((1.0 - b) * e + b * depth > 0) & (d + a * Z > 0);
    } else {
        double inside = Z * Z - 4.0 * a * square, reach = sqrt(inside);
        double product = -4.0 * a * square / (reach - Z);
        divisor = 0.5 * (Z < 0 ? product : Z + reach);
        seen = (inside > 0) & ((Z > 0) | (a < 0));
    }
    *x = X / divisor; *y = Y / divisor;
    return seen & (square + Z * Z > TINY) & (square + Z * Z < HUGE_SQUARE);
}

/* Unit direction of a point in the plane; for ANGLE, `t` is its angle from the axis. */
INLINE int front_direction(int front, Plan p, double x, double y, double t, double *X, double *Y, double *Z) {
    double square = x * x + y * y, a = p[F1], b = p[F1 + 1], k;
    if (front == PERSPECTIVE) {
        *Z = k = 1.0 / sqrt(1.0 + square);
        *X = x * k; *Y = y * k;
        return 1;
    }
    if (front == ANGLE) {
        k = square > 0 ? sin(t) / sqrt(square) : 1.0;
        *X = x * k; *Y = y * k; *Z = cos(t);
        return t >= 0 && t < p[LIMIT] && (square > TINY || (x == 0 && y == 0));
    }
    if (front == DIVISION) {
        double z = 1.0 + a * square;
        k = 1.0 / sqrt(square + z * z);
        *X = x * k; *Y = y * k; *Z = z * k;
        return a * square < 1.0 && square + z * z < HUGE_SQUARE;
    }
    if (front == UNIFIED) {
        double inside = 1.0 + (1.0 - a * a) * square;
        k = (a + sqrt(inside)) / (square + 1.0);
        *X = x * k; *Y = y * k; *Z = k - a;
        return inside > 0 && square < FAR;
    }
    double alpha = front == EUCM ? a : b, beta = front == EUCM ? b : 1.0;
    double inside = 1.0 - (2.0 * alpha - 1.0) * beta * square;
    double z = (1.0 - alpha * alpha * beta * square) / (1.0 - alpha + alpha * sqrt(inside));
    if (front == EUCM) {
        k = 1.0 / sqrt(square + z * z);
        *X = x * k; *Y = y * k; *Z = z * k;
        return inside > 0 && square + z * z < HUGE_SQUARE;
    }
    double outline = z * z + (1.0 - a * a) * square;
    k = (z * a + sqrt(outline)) / (z * z + square);
    *X = x * k; *Y = y * k; *Z = z * k - a;
    return inside > 0 && outline > 0 && square < FAR;
}

/* The steps by blocks, each with a loop of its own for every front or plane, so that no loop asks which it is. Only the
   planes' steps are worth a copy for each kind of processor. */
#define EACH_FRONT(step)                       \
    switch (front) {                           \
        case PERSPECTIVE: step(PERSPECTIVE)    \
        case ANGLE: step(ANGLE)                \
        case UNIFIED: step(UNIFIED)            \
        case EUCM: step(EUCM)                  \
        case DOUBLE_SPHERE: step(DOUBLE_SPHERE) \
        default: step(DIVISION)                \
    }
#define EACH_PLANE(step)                       \
    switch (plane) {                           \
        case NONE: step(NONE)                  \
        case RADIAL: step(RADIAL)              \
        case BROWN: step(BROWN)                \
        default: step(GENERAL)                 \
    }

CLONES static void fronts(Plan given, int n, const double *__restrict X, const double *__restrict Y, const double *__restrict Z, double *__restrict x, double *__restrict y, int *__restrict seen) {
    double p[SIZE]; /* a copy, so that no array can be the plan */
    for (int i = 0; i < SIZE; i++) p[i] = given[i];
    int front = (int)p[FRONT];
#define STEP(front)                                                                                     \
    for (int i = 0; i < n; i++) seen[i] = front_image(front, p, X[i], Y[i], Z[i], x + i, y + i);        \
    return;
    EACH_FRONT(STEP)
#undef STEP
}

CLONES static void directions(Plan given, int n, const double *__restrict x, const double *__restrict y,
                              const double *__restrict t, double *__restrict X, double *__restrict Y,
                              double *__restrict Z, int *__restrict seen) {
    double p[SIZE];
    for (int i = 0; i < SIZE; i++) p[i] = given[i];
    int front = (int)p[FRONT];
#define STEP(front)                                                                                     \
    for (int i = 0; i < n; i++) seen[i] = front_direction(front, p, x[i], y[i], t[i], X + i, Y + i, Z + i); \
    return;
    EACH_FRONT(STEP)
#undef STEP
}

/* Pixels of points in the plane; `seen` becomes 0 where one is not in the valid disc. */
CLONES static void planes(Plan given, int n, const double *__restrict x, const double *__restrict y, double *__restrict a, double *__restrict b, int *__restrict seen) {
    double p[SIZE];
    for (int i = 0; i < SIZE; i++) p[i] = given[i];
    int plane = (int)p[PLANE];
#define STEP(plane)                                                                                     \
    for (int i = 0; i < n; i++) {                                                                       \
        double u, v;                                                                                    \
        plane_image(plane, p, x[i], y[i], &u, &v);                                                      \
        a[i] = p[FX] * u + (p[SKEW] * v + p[CX]);                                                       \
        b[i] = p[FY] * v + p[CY];                                                                       \
        seen[i] &= x[i] * x[i] + y[i] * y[i] < p[SQUARE];                                               \
    }                                                                                                   \
    return;
    EACH_PLANE(STEP)
#undef STEP
}

/* Newton's method in the plane: `unsettled` is at most 0 and `steep` positive where the result is as good as the
   reference's. The start is one step of the fixed-point iteration, where that stays on its side and in the valid disc. */
INLINE void plane_inverse(int plane, Plan p, int n, const double *__restrict u, const double *__restrict v, double *__restrict x, double *__restrict y,
                          double *__restrict unsettled, double *__restrict steep) {
    for (int i = 0; i < n; i++) {
        double a, b;
        plane_image(plane, p, u[i], v[i], &a, &b);
        double s = u[i] + (u[i] - a), t = v[i] + (v[i] - b);
        int far = !((s * u[i] + t * v[i] > 0.0) & (s * s + t * t < p[SQUARE]));
        x[i] = far ? u[i] : s;
        y[i] = far ? v[i] : t;
    }
    for (int step = 0; step < NEWTON_STEPS; step++) {
        double worst = 0.0;
        for (int i = 0; i < n; i++) {
            double a, b, J[4], square = x[i] * x[i] + y[i] * y[i];
            plane_jacobian(plane, p, x[i], y[i], &a, &b, J);
            a -= u[i];
            b -= v[i];
            double det = J[0] * J[3] - J[1] * J[2], by = 1.0 / det;
            double dx = (J[1] * b - J[3] * a) * by, dy = (J[2] * a - J[0] * b) * by;
            x[i] += dx;
            y[i] += dy;
            unsettled[i] = dx * dx + dy * dy - SETTLED * square;
            steep[i] = det - WELL_CONDITIONED * (J[0] * J[0] + J[1] * J[1] + J[2] * J[2] + J[3] * J[3]);
        }
        for (int i = 0; i < n; i++) worst = unsettled[i] <= 0.0 ? worst : 1.0;
        if (worst == 0.0) break;
    }
}

CLONES static void plane_inverses(Plan given, int n, const double *__restrict u, const double *__restrict v, double *__restrict x, double *__restrict y,
                                  double *__restrict unsettled, double *__restrict steep) {
    double p[SIZE];
    for (int i = 0; i < SIZE; i++) p[i] = given[i];
    int plane = (int)p[PLANE];
#define STEP(plane) plane_inverse(plane, p, n, u, v, x, y, unsettled, steep); return;
    EACH_PLANE(STEP)
#undef STEP
}

CLONES static void angle_inverses(Plan given, int n, const double *__restrict x, const double *__restrict y, double *__restrict t, double *__restrict unsettled,
                                  double *__restrict steep) {
    double p[SIZE];
    for (int i = 0; i < SIZE; i++) p[i] = given[i];
    for (int i = 0; i < n; i++) {
        double r = sqrt(x[i] * x[i] + y[i] * y[i]);
        t[i] = r < p[START] ? r : p[START];
    }
    for (int step = 0; step < ANGLE_STEPS; step++) {
        double worst = 0.0;
        for (int i = 0; i < n; i++) {
            double r = sqrt(x[i] * x[i] + y[i] * y[i]), slope = angle_slope(p, t[i]);
            double dt = (angle_image(p, t[i]) - r) / slope;
            t[i] -= dt;
            unsettled[i] = dt * dt - SETTLED * t[i] * t[i];
            steep[i] = slope - WELL_CONDITIONED;
        }
        for (int i = 0; i < n; i++) worst = unsettled[i] <= 0.0 ? worst : 1.0;
        if (worst == 0.0) break;
    }
}

static Py_ssize_t project(Plan p, const double *rays, Py_ssize_t n, double *pixels) {
    Py_ssize_t lost = 0;
    for (Py_ssize_t at = 0; at < n; at += BLOCK) {
        int count = (int)(n - at < BLOCK ? n - at : BLOCK), seen[BLOCK];
        double X[BLOCK], Y[BLOCK], Z[BLOCK], x[BLOCK], y[BLOCK], a[BLOCK], b[BLOCK];
        const double *ray = rays + 3 * at;
        double *pixel = pixels + 2 * at;
        for (int i = 0; i < count; i++) {
            X[i] = ray[3 * i];
            Y[i] = ray[3 * i + 1];
            Z[i] = ray[3 * i + 2];
        }
        fronts(p, count, X, Y, Z, x, y, seen);
        planes(p, count, x, y, a, b, seen);
        for (int i = 0; i < count; i++) {
            int good = seen[i] & (fabs(a[i]) < INFINITY) & (fabs(b[i]) < INFINITY);
            pixel[2 * i] = good ? a[i] : NAN;
            pixel[2 * i + 1] = good ? b[i] : NAN;
            lost += !good;
        }
    }
    return lost;
}

/* Points of the plane out of pixels; before the plane's terms, if it has any. */
CLONES static void centred(Plan p, int n, const double *__restrict pixel, double *__restrict u, double *__restrict v) {
    double cx = p[CX], cy = p[CY], fx = p[FX], fy = p[FY], skew = p[SKEW];
    for (int i = 0; i < n; i++) {
        v[i] = (pixel[2 * i + 1] - cy) / fy;
        u[i] = (pixel[2 * i] - cx - skew * v[i]) / fx;
    }
}

/* The rays that are good, NaN in place of the others, and the number of these. */
CLONES static int judged(double square, int n, const double *__restrict x, const double *__restrict y,
                         const double *__restrict X, const double *__restrict Y, const double *__restrict Z,
                         const double *__restrict unsettled, const double *__restrict steep,
                         const double *__restrict doubt, const double *__restrict bend, const int *__restrict seen,
                         double *__restrict ray) {
    int lost = 0;
    for (int i = 0; i < n; i++) {
        int good = seen[i] & (unsettled[i] <= 0.0) & (steep[i] > 0.0) & (doubt[i] <= 0.0) & (bend[i] > 0.0);
        good &= (x[i] * x[i] + y[i] * y[i] < square) & (fabs(X[i]) <= 2.0) & (fabs(Y[i]) <= 2.0) & (fabs(Z[i]) <= 2.0);
        ray[3 * i] = good ? X[i] : NAN;
        ray[3 * i + 1] = good ? Y[i] : NAN;
        ray[3 * i + 2] = good ? Z[i] : NAN;
        lost += !good;
    }
    return lost;
}

static Py_ssize_t unproject(Plan p, const double *pixels, Py_ssize_t n, double *rays) {
    Py_ssize_t lost = 0;
    int seen[BLOCK], plane = (int)p[PLANE], front = (int)p[FRONT];
    double u[BLOCK], v[BLOCK], x[BLOCK], y[BLOCK], t[BLOCK], unsettled[BLOCK], steep[BLOCK], doubt[BLOCK], bend[BLOCK];
    double X[BLOCK], Y[BLOCK], Z[BLOCK];
    for (int i = 0; i < BLOCK; i++) { /* for models without the steps that set them */
        t[i] = unsettled[i] = doubt[i] = 0.0;
        steep[i] = bend[i] = 1.0;
    }
    for (Py_ssize_t at = 0; at < n; at += BLOCK) {
        /* Whole vectors: loops over a few points more are quicker than loops with a remainder. */
        int count = (int)(n - at < BLOCK ? n - at : BLOCK), width = count < 8 ? count : (count + 7) & ~7;
        centred(p, count, pixels + 2 * at, u, v);
        for (int i = count; i < width; i++) u[i] = v[i] = 0.0;
        for (int i = 0; i < width; i++) {
            x[i] = u[i];
            y[i] = v[i];
        }
        if (plane != NONE) plane_inverses(p, width, u, v, x, y, unsettled, steep);
        if (front == ANGLE) angle_inverses(p, width, x, y, t, doubt, bend);
        directions(p, count, x, y, t, X, Y, Z, seen);
        lost += judged(p[SQUARE], count, x, y, X, Y, Z, unsettled, steep, doubt, bend, seen, rays + 3 * at);
    }
    return lost;
}

/* Where the pixels of a pinhole's image, k = (1/fx, 1/fy, cx, cy, slack), lie in the camera's image of w × h px, from
   the centre of its first pixel; -1 and not seen where it has none. */
CLONES static void map(Plan p, const double *k, Py_ssize_t row, Py_ssize_t rows, Py_ssize_t width, double w, double h,
                       float *mx, float *my, unsigned char *in) {
    double X[BLOCK], Y[BLOCK], Z[BLOCK], x[BLOCK], y[BLOCK], a[BLOCK], b[BLOCK];
    int seen[BLOCK], perspective = p[FRONT] == PERSPECTIVE;
    for (int i = 0; i < BLOCK; i++) Z[i] = 1.0;
    for (Py_ssize_t j = 0; j < rows; j++) {
        double depth = ((double)(row + j) + 0.5 - k[3]) * k[1];
        for (Py_ssize_t at = 0; at < width; at += BLOCK) {
            int count = (int)(width - at < BLOCK ? width - at : BLOCK);
            float *__restrict to_x = mx + j * width + at, *__restrict to_y = my + j * width + at;
            unsigned char *__restrict to = in + j * width + at;
            for (int i = 0; i < count; i++) {
                X[i] = ((double)(at + i) + 0.5 - k[2]) * k[0];
                Y[i] = depth;
                seen[i] = 1;
            }
            if (!perspective) fronts(p, count, X, Y, Z, x, y, seen);
            planes(p, count, perspective ? X : x, perspective ? Y : y, a, b, seen);
            for (int i = 0; i < count; i++) {
                double s = a[i] - 0.5, t = b[i] - 0.5;
                int good = seen[i] & (s >= -0.5 - k[4]) & (s <= w - 0.5 + k[4]) & (t >= -0.5 - k[4]) & (t <= h - 0.5 + k[4]);
                to_x[i] = good ? (float)s : -1.0f;
                to_y[i] = good ? (float)t : -1.0f;
                to[i] = (unsigned char)good;
            }
        }
    }
}

static int held(PyObject *object, Py_buffer *buffer, int writable, Py_ssize_t bytes, const char *what) {
    if (PyObject_GetBuffer(object, buffer, writable ? PyBUF_WRITABLE : PyBUF_SIMPLE) < 0) return -1;
    if (bytes < 0 || buffer->len == bytes) return 0;
    PyErr_Format(PyExc_ValueError, "%s has %zd bytes, expected %zd", what, buffer->len, bytes);
    PyBuffer_Release(buffer);
    return -1;
}

typedef Py_ssize_t (*Rows)(Plan, const double *, Py_ssize_t, double *);

static PyObject *by_rows(PyObject *args, Rows function, int columns, int into) {
    PyObject *a, *b, *c;
    Py_buffer plan, rows, out;
    if (!PyArg_UnpackTuple(args, "kernel", 3, 3, &a, &b, &c)) return NULL;
    if (held(a, &plan, 0, SIZE * sizeof(double), "the plan") < 0) return NULL;
    if (held(b, &rows, 0, -1, "the rows") < 0) goto release_plan;
    Py_ssize_t n = rows.len / ((Py_ssize_t)sizeof(double) * columns), lost = 0;
    if (held(c, &out, 1, n * (Py_ssize_t)sizeof(double) * into, "the result") < 0) goto release_rows;
    if (n < 2000) { /* letting others run costs more than so few points */
        lost = function(plan.buf, rows.buf, n, out.buf);
    } else {
        Py_BEGIN_ALLOW_THREADS
        lost = function(plan.buf, rows.buf, n, out.buf);
        Py_END_ALLOW_THREADS
    }
    PyBuffer_Release(&out);
    PyBuffer_Release(&rows);
    PyBuffer_Release(&plan);
    return PyLong_FromSsize_t(lost);
release_rows:
    PyBuffer_Release(&rows);
release_plan:
    PyBuffer_Release(&plan);
    return NULL;
}

static PyObject *py_project(PyObject *module, PyObject *args) {
    (void)module;
    return by_rows(args, project, 3, 2);
}

static PyObject *py_unproject(PyObject *module, PyObject *args) {
    (void)module;
    return by_rows(args, unproject, 2, 3);
}

static PyObject *py_map(PyObject *module, PyObject *args) {
    (void)module;
    PyObject *o[5];
    Py_ssize_t row, rows, width, wanted[5];
    double w, h;
    Py_buffer b[5];
    if (!PyArg_ParseTuple(args, "OOnnnddOOO", o, o + 1, &row, &rows, &width, &w, &h, o + 2, o + 3, o + 4)) return NULL;
    if (rows < 0 || width < 0 || (width && rows > PY_SSIZE_T_MAX / (Py_ssize_t)sizeof(float) / width)) {
        PyErr_SetString(PyExc_ValueError, "no map has so many pixels");
        return NULL;
    }
    wanted[0] = SIZE * sizeof(double);
    wanted[1] = 5 * sizeof(double);
    wanted[2] = wanted[3] = rows * width * (Py_ssize_t)sizeof(float);
    wanted[4] = rows * width;
    for (int i = 0; i < 5; i++) {
        if (held(o[i], b + i, i > 1, wanted[i], "an argument") == 0) continue;
        while (i-- > 0) PyBuffer_Release(b + i);
        return NULL;
    }
    Py_BEGIN_ALLOW_THREADS
    map(b[0].buf, b[1].buf, row, rows, width, w, h, b[2].buf, b[3].buf, b[4].buf);
    Py_END_ALLOW_THREADS
    for (int i = 0; i < 5; i++) PyBuffer_Release(b + i);
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"project", py_project, METH_VARARGS, NULL},
    {"unproject", py_unproject, METH_VARARGS, NULL},
    {"map", py_map, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};

static int prepare(PyObject *module) { return PyModule_AddIntConstant(module, "LAYOUT", LAYOUT); }

static PyModuleDef_Slot slots[] = {{Py_mod_exec, (void *)prepare}, {0, NULL}};
static struct PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_kernel", NULL, 0, methods, slots, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__kernel(void) { return PyModuleDef_Init(&definition); }
