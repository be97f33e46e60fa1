/* lanes.h - several runs in the lanes of a vector: the C of a model compiled as C++ with a vector
 * in the place of every double.
 *
 * build/lanes.py includes this header before a model. Every operation on a vector is the operation
 * of C on each of its doubles, so that a lane has the same bits as its run alone. A comparison
 * gives a Mask. Where the program must know one answer, as in `if`, all lanes must agree. If they
 * do not, the step of the component splits: its execution ends there, and the step is repeated once
 * for the lanes in which the answer is true and once for the other lanes, see step_in_lanes(). */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef LANES_H
#define LANES_H

#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <tuple>
#include <type_traits>
#include <utility>

#define restrict __restrict__
#define INLINE   __attribute__((always_inline)) inline
#ifdef __clang__
#define OPAQUE noinline
#else
#define OPAQUE noipa
#endif

/* the original functions of one double; a vector function that needs tables or integers calls them
 * once per lane */
namespace scalar
{
#include "scalar/portable_math.h"
#include "scalar/rules.h"
#if __has_include("scalar/random.h")
#include "scalar/random.h"
#endif
} // namespace scalar
#undef FMU_H
#undef VEC3_H

#ifndef WIDTH
#define WIDTH 4
#endif

namespace lanes
{
typedef double Numbers __attribute__((vector_size(8 * WIDTH)));
typedef int64_t Answers __attribute__((vector_size(8 * WIDTH))); /* per lane -1: true, 0: false */

/* ---- answers that differ ---- */
struct Split {
    jmp_buf place; /* where split() returns to: in performed(), before the call of the function */
    int answer;    /* bits of the active lanes in which the answer is true */
    Split *outer;  /* Split of the enclosing call of performed() */
};
inline Split *present; /* Split of the innermost running call of performed() */
inline jmp_buf again; /* place in runs.h from which macro steps are repeated, see step_in_lanes() */
inline int active = (1 << WIDTH) - 1; /* bits of the lanes that are computed */

[[noreturn]] __attribute__((noinline, cold)) inline void split(int answer)
{
    present->answer = answer;
    longjmp(present->place, 1);
}

/* performs a function; false: the function was left, because the active lanes differ in a
 * condition, whose answers are in here->answer. In this case setjmp() returns a second time; OPAQUE
 * prevents optimizations across performed(), which assume that a function returns once. */
__attribute__((OPAQUE)) inline bool performed(Split *here, void (*function)(void *), void *given)
{
    here->outer = present;
    if (setjmp(here->place)) {
        present = present->outer;
        return false;
    }
    present = here;
    function(given);
    present = here->outer;
    return true;
}

/* the answer as one bool for all active lanes; splits if the lanes differ */
INLINE bool agreed(int answer)
{
    if (__builtin_expect(answer != 0 && answer != active, 0)) split(answer);
    return answer != 0;
}

#if defined __AVX512DQ__ && WIDTH == 8
inline int signs(Answers a)
{
    return __builtin_ia32_cvtq2mask512((long long __attribute__((vector_size(64))))a);
}
#elif defined __AVX__ && WIDTH == 4
inline int signs(Answers a) { return __builtin_ia32_movmskpd256((Numbers)a); }
#elif defined __SSE2__ && WIDTH == 2
inline int signs(Answers a) { return __builtin_ia32_movmskpd((Numbers)a); }
#else
inline int signs(Answers a)
{
    int all = 0;
    for (int i = 0; i < WIDTH; i++) all |= a[i] ? 1 << i : 0;
    return all;
}
#endif
#ifdef __clang__
inline Numbers roots(Numbers a) { return __builtin_elementwise_sqrt(a); }
#elif defined __AVX512F__ && WIDTH == 8
inline Numbers roots(Numbers a) { return __builtin_ia32_sqrtpd512_mask(a, a, -1, 4); }
#elif defined __AVX__ && WIDTH == 4
inline Numbers roots(Numbers a) { return __builtin_ia32_sqrtpd256(a); }
#elif defined __SSE2__ && WIDTH == 2
inline Numbers roots(Numbers a) { return __builtin_ia32_sqrtpd(a); }
#else
inline Numbers roots(Numbers a)
{
    for (int i = 0; i < WIDTH; i++) a[i] = sqrt(a[i]);
    return a;
}
#endif

struct Vector;

struct Mask {
    Answers answer;
    Mask() = default;
    constexpr Mask(Answers a) : answer(a) {}
    inline Mask(Vector x);
    explicit Mask(bool b) : answer(Answers{} - (int64_t)b) {}
    int bits() const { return signs(answer) & active; }
    operator bool() const { return agreed(bits()); }
    friend Mask operator!(Mask a) { return ~a.answer; }
    friend Mask operator==(Mask a, Mask b) { return a.answer == b.answer; }
    friend Mask operator!=(Mask a, Mask b) { return a.answer != b.answer; }
};

template <class T>
concept Number = std::is_arithmetic_v<T> || std::is_enum_v<T>;

struct Vector {
    Numbers v;
    Vector() = default;
    constexpr Vector(Numbers given) : v(given) {}
    template <Number T> constexpr Vector(T x) : v(all((double)x, std::make_index_sequence<WIDTH>()))
    {
    }
    Vector(Mask m) : v((Numbers)((Answers)Vector(1.0).v & m.answer)) {}
    template <size_t... I> static constexpr Numbers all(double x, std::index_sequence<I...>)
    {
        return Numbers{((void)I, x)...};
    }
    /* conversion to a whole number, a mode or a condition: one value for all active lanes; the
     * step splits if the lanes differ */
    template <Number T> explicit operator T() const
    {
        if constexpr (std::is_same_v<T, bool>) return Mask(v != 0);
        else if constexpr (std::is_floating_point_v<T>) {
            agreed(Mask(v == Vector(v[__builtin_ctz(active)]).v).bits());
            return v[__builtin_ctz(active)];
        } else {
            const T first = (T)v[__builtin_ctz(active)];
            int same = 0;
            for (int i = 0; i < WIDTH; i++) same |= (T)v[i] == first ? 1 << i : 0;
            agreed(same & active);
            return first;
        }
    }
    Vector operator-() const { return -v; }
    Vector operator+() const { return *this; }
    Vector &operator+=(Vector b) { return v += b.v, *this; }
    Vector &operator-=(Vector b) { return v -= b.v, *this; }
    Vector &operator*=(Vector b) { return v *= b.v, *this; }
    Vector &operator/=(Vector b) { return v /= b.v, *this; }
    Vector &operator++() { return v += 1, *this; }
    Vector operator++(int)
    {
        const Vector before = *this;
        v += 1;
        return before;
    }
    Vector &operator--() { return v -= 1, *this; }
    Vector operator--(int)
    {
        const Vector before = *this;
        v -= 1;
        return before;
    }
    friend Vector operator+(Vector a, Vector b) { return a.v + b.v; }
    friend Vector operator-(Vector a, Vector b) { return a.v - b.v; }
    friend Vector operator*(Vector a, Vector b) { return a.v * b.v; }
    friend Vector operator/(Vector a, Vector b) { return a.v / b.v; }
    friend Mask operator<(Vector a, Vector b) { return a.v < b.v; }
    friend Mask operator<=(Vector a, Vector b) { return a.v <= b.v; }
    friend Mask operator>(Vector a, Vector b) { return a.v > b.v; }
    friend Mask operator>=(Vector a, Vector b) { return a.v >= b.v; }
    friend Mask operator==(Vector a, Vector b) { return a.v == b.v; }
    friend Mask operator!=(Vector a, Vector b) { return a.v != b.v; }
    friend Mask operator!(Vector a) { return a.v == 0; }
};
inline Mask::Mask(Vector x) : answer(x.v != 0) {}

template <class T>
concept Whole_ = std::is_integral_v<T> || std::is_enum_v<T>;
template <class T>
concept Answer = std::is_same_v<T, Mask> || std::is_same_v<T, Vector>;
template <Answer A, Answer B> inline Mask operator&&(A a, B b)
{
    return Mask(a).answer & Mask(b).answer;
}
template <Answer A, Answer B> inline Mask operator||(A a, B b)
{
    return Mask(a).answer | Mask(b).answer;
}

/* ---- both branches of `c ? a : b`, blended ---- */
INLINE Vector blend(Mask m, Vector a, Vector b) { return m.answer ? a.v : b.v; }
INLINE Mask blend(Mask m, Mask a, Mask b) { return (m.answer & a.answer) | (~m.answer & b.answer); }

/* true if a type T consists of vectors only, so that blending its vectors blends the whole */
template <class T, size_t... I> constexpr bool accepts_lanes(std::index_sequence<I...>)
{
    return requires(Vector x) { T{((void)I, x)...}; };
}
template <class T> constexpr bool is_of_lanes()
{
    if constexpr (!std::is_aggregate_v<T> || sizeof(T) % sizeof(Vector) != 0) return false;
    else return accepts_lanes<T>(std::make_index_sequence<sizeof(T) / sizeof(Vector)>());
}
template <class T> constexpr bool is_blended()
{
    return std::is_same_v<T, Vector> || std::is_same_v<T, Mask> || is_of_lanes<T>();
}
template <class T>
    requires(is_of_lanes<T>())
INLINE T blend(Mask m, T a, T b)
{
    Vector *x = (Vector *)&a;
    const Vector *y = (const Vector *)&b;
    for (size_t i = 0; i < sizeof(T) / sizeof(Vector); i++) x[i] = blend(m, x[i], y[i]);
    return a;
}

/* result of c ? a : b for whole numbers a and b: converts to a vector or, if all lanes agree in
 * c, to one number */
template <class N> struct Whole {
    Mask c;
    N a, b;
    operator Vector() const { return blend(c, Vector(a), Vector(b)); }
    template <Number T> operator T() const { return (bool)c ? (T)a : (T)b; }
};

template <class T> inline constexpr bool IsChosen = false;
template <class N> inline constexpr bool IsChosen<Whole<N>> = true;
template <> inline constexpr bool IsChosen<Mask> = true;

template <class A, class B> constexpr auto common(int)
{
    if constexpr (std::is_same_v<A, B> && !Number<A>) return std::type_identity<A>();
    else if constexpr (Number<A> && Number<B>) return std::type_identity<Vector>();
    else if constexpr ((std::is_same_v<A, Vector> || Number<A>) &&
                       (std::is_same_v<B, Vector> || Number<B>))
        return std::type_identity<Vector>();
    else if constexpr (std::is_same_v<A, Mask> && std::is_same_v<B, bool>)
        return std::type_identity<Mask>();
    else if constexpr (std::is_same_v<B, Mask> && std::is_same_v<A, bool>)
        return std::type_identity<Mask>();
    else if constexpr (std::is_same_v<A, Mask> || std::is_same_v<B, Mask>)
        return std::type_identity<Vector>();
    else return std::type_identity<std::common_type_t<A, B>>();
}

/* c ? a() : b(): blended per lane if T can be blended, otherwise one branch for all active lanes; a
 * function whose value no active lane needs is not called */
template <class T, class A, class B> INLINE T chosen(Mask c, A a, B b)
{
    if constexpr (is_blended<T>()) {
        T first = {}, second = {};
        const int bits = c.bits();
        if (bits != 0) first = T(a());
        if (bits != active) second = T(b());
        return blend(c, first, second);
    } else return (bool)c ? T(a()) : T(b());
}

/* c ? a() : b() with the common type of both results */
template <class C, class A, class B> INLINE auto choose(C c, A a, B b)
{
    using FirstType = std::remove_cvref_t<decltype(a())>;
    using SecondType = std::remove_cvref_t<decltype(b())>;
    if constexpr (std::is_pointer_v<FirstType>) {
        return c ? a() : (FirstType)b();
    } else if constexpr (std::is_pointer_v<SecondType>) {
        return c ? (SecondType)a() : b();
    } else if constexpr ((IsChosen<FirstType> && Whole_<SecondType>) ||
                         (Whole_<FirstType> && IsChosen<SecondType>)) {
        return c ? (long)a() : (long)b();
    } else if constexpr (Answer<C> && Whole_<FirstType> && Whole_<SecondType>) {
        return Whole<std::common_type_t<FirstType, SecondType>>{Mask(c), a(), b()};
    } else if constexpr (Answer<C>) {
        using T = typename decltype(common<FirstType, SecondType>(0))::type;
        return chosen<T>(Mask(c), a, b);
    } else if constexpr (Number<FirstType> && Number<SecondType>) {
        return c ? a() : b();
    } else {
        using T = typename decltype(common<FirstType, SecondType>(0))::type;
        return c ? T(a()) : T(b());
    }
}
/* c ? a() : b() as a T, for the `return` of a function with the type T */
template <class T, class C, class A, class B> INLINE T choose_as(C c, A a, B b)
{
    if constexpr (Answer<C>) return chosen<T>(Mask(c), a, b);
    else return c ? T(a()) : T(b());
}

/* ---- exact.h and math.h ---- */
inline Vector fabs(Vector x) { return (Numbers)((Answers)x.v & INT64_MAX); }
inline Vector copysign(Vector x, Vector sign)
{
    return (Numbers)(((Answers)x.v & INT64_MAX) | ((Answers)sign.v & INT64_MIN));
}
inline Vector sqrt(Vector x) { return roots(x.v); }
inline Mask isnan(Vector x) { return x.v != x.v; }
inline Mask isfinite(Vector x) { return fabs(x) <= DBL_MAX; }
inline Mask signbit(Vector x) { return (Answers)x.v < 0; }
inline Vector smaller(Vector a, Vector b) { return blend(a < b || isnan(b), a, b); }
inline Vector larger(Vector a, Vector b) { return blend(a > b || isnan(b), a, b); }
inline Vector nearest_whole(Vector x)
{
    const Vector size = fabs(x);
    return blend(size < ALL_WHOLE, copysign(size + ALL_WHOLE - ALL_WHOLE, x), x);
}
inline Vector floor_of(Vector x)
{
    const Vector n = nearest_whole(x);
    return blend(n > x, n - 1, n);
}
inline Vector ceiling_of(Vector x) { return -floor_of(-x); }

/* bits of a vector, which can only be compared: any other use does not compile */
struct Bits {
    Answers bits;
    friend Mask operator==(Bits a, Bits b) { return a.bits == b.bits; }
};
inline Bits bits_of(Vector x) { return {(Answers)x.v}; }

/* ---- portable_math.h ---- */
template <class F, class... Given> inline Vector each(F function, Given... given)
{
    Vector found = 0;
    for (int i = 0; i < WIDTH; i++)
        if (active >> i & 1) found.v[i] = function(given.v[i]...);
    return found;
}
inline int last_bits(Vector rounded, uint64_t mask)
{
    return (int)each([=](double x) { return (double)scalar::last_bits(x, mask); }, rounded);
}

inline Vector arc_tangent(Vector y, Vector x) { return each(scalar::arc_tangent, y, x); }
inline Vector exponential(Vector x) { return each(scalar::exponential, x); }
inline Vector exponential_less_1(Vector x) { return each(scalar::exponential_less_1, x); }
inline Vector logarithm(Vector x) { return each(scalar::logarithm, x); }

struct SineCosine { Vector s, c; };

inline Vector sine_series(Vector hi, Vector lo)
{
    const double *k = scalar::sine_terms;
    const Vector z = hi * hi, zz = z * z;
    const Vector sum = (k[0] + z * k[1]) + zz * ((k[2] + z * k[3]) + zz * (k[4] + z * k[5]));
    return hi + (hi * z * sum + (lo - lo * (0.5 * z)));
}

inline Vector cosine_series(Vector hi, Vector lo)
{
    const double *k = scalar::cosine_terms;
    const Vector z = hi * hi, zz = z * z, half = 0.5 * z, w = 1 - half;
    const Vector sum = (k[0] + z * k[1]) + zz * ((k[2] + z * k[3]) + zz * (k[4] + z * k[5]));
    return w + ((1 - w - half) + (zz * sum - hi * lo));
}

/* sine and cosine by the operations of reduced() in portable_math.h for all lanes; a lane with |x|
 * >= 1e6, near a multiple of pi/2 or not finite is computed alone */
inline SineCosine sine_and_cosine(Vector x)
{
    const Vector size = fabs(x), rounded = x * TWO_OVER_PI + ROUNDER, n = rounded - ROUNDER;
    const Vector a = x - n * HALF_PI_1, b = n * HALF_PI_2, c = n * HALF_PI_3;
    const Vector d = a - b, recovered = a - d, rounding = (recovered - b) + (a - (d + recovered));
    const Mask small = size <= PI / 4;
    const Vector far = d - c, hi = blend(small, x, far);
    const Vector lo = blend(small, Vector(0.0), (d - far - c) + rounding);
    const Mask plain = small || (size < 1e6 && fabs(d) > fabs(n) * 0x1p-54);
    const Answers quarter = (Answers)rounded.v & ~small.answer;
    const Mask odd = (quarter & 1) != 0;
    const Vector s = sine_series(hi, lo), o = cosine_series(hi, lo);
    const Vector sine = blend(odd, o, s), cosine = blend(odd, s, o);
    const Answers upper = Answers{} + INT64_MIN;
    SineCosine both = {(Numbers)((Answers)sine.v ^ ((quarter & 2) != 0 & upper)),
                       (Numbers)((Answers)cosine.v ^ (((quarter + 1) & 2) != 0 & upper))};
    const Mask tiny = size < 0x1p-27;
    both.s = blend(tiny, x, both.s);
    both.c = blend(tiny, Vector(1.0), both.c);
    if (const int others = (!plain).bits())
        for (int i = 0; i < WIDTH; i++)
            if (others >> i & 1) {
                const scalar::SineCosine one = scalar::sine_and_cosine(x.v[i]);
                both.s.v[i] = one.s;
                both.c.v[i] = one.c;
            }
    return both;
}
inline Vector sine(Vector x) { return sine_and_cosine(x).s; }
inline Vector cosine(Vector x) { return sine_and_cosine(x).c; }

/* replaces a designated initializer of C: assign() sets the members that the initializer names */
template <class F> struct Made {
    F assign;
    template <class T> operator T() const
    {
        T all = {};
        assign(all);
        return all;
    }
};
template <class T> struct Held { T value; };
template <class T> inline void set(T &to, Held<T> from) { memcpy(&to, &from.value, sizeof to); }
} /* namespace lanes */

using lanes::arc_tangent, lanes::exponential, lanes::SineCosine;

/* ---- a model ---- */
#define double lanes::Vector
#include "fmu.h"
#include "vec3.h"
#undef double
#define double lanes::Vector

#undef MODEL_STRUCT
#define MODEL_STRUCT             \
    void single_object(State *); \
    void single_object(Output *)

/* the lanes need neither the table of a model nor its checks and initialization: the FMU of each
 * run performs these before the lanes begin */
#undef FMU_MODEL_OF
#define FMU_MODEL_OF(...) extern "C" void this_model_has_no_table(void)

#undef double
#undef double
#ifdef RANDOM_H /* random numbers: the functions of random.h for each lane */
struct RandomStream { lanes::Vector seed, stream; };
struct Draws { scalar::Draws of[WIDTH]; };
inline scalar::RandomStream stream_of(const RandomStream *r, int i)
{
    return {r->seed.v[i], r->stream.v[i]};
}
inline void check_random(Problems *, const RandomStream *) {}
inline lanes::Vector remainder_of(lanes::Vector x, lanes::Vector divisor)
{
    return x - divisor * floor_of(x / divisor);
}
inline Draws draws_of_sample(const RandomStream *r, lanes::Vector n)
{
    Draws all = {};
    for (int i = 0; i < WIDTH; i++) {
        if (!(lanes::active >> i & 1)) continue;
        const scalar::RandomStream one = stream_of(r, i);
        all.of[i] = scalar::draws_of_sample(&one, n.v[i]);
    }
    return all;
}
inline Draws draws_of_run(const RandomStream *r)
{
    Draws all = {};
    for (int i = 0; i < WIDTH; i++) {
        if (!(lanes::active >> i & 1)) continue;
        const scalar::RandomStream one = stream_of(r, i);
        all.of[i] = scalar::draws_of_run(&one);
    }
    return all;
}
inline lanes::Vector uniform(const Draws *d, unsigned j)
{
    lanes::Vector all = 0;
    for (int i = 0; i < WIDTH; i++)
        if (lanes::active >> i & 1) all.v[i] = scalar::uniform(&d->of[i], j);
    return all;
}
inline lanes::Vector normal(const Draws *d, unsigned j)
{
    lanes::Vector all = 0;
    for (int i = 0; i < WIDTH; i++)
        if (lanes::active >> i & 1) all.v[i] = scalar::normal(&d->of[i], j);
    return all;
}
inline vec3 normals(const Draws *d, unsigned j)
{
    return vec(normal(d, j), normal(d, j + 1), normal(d, j + 2));
}
inline vec3 symmetric_uniforms(const Draws *d, unsigned j)
{
    return vec(2 * uniform(d, j) - 1, 2 * uniform(d, j + 1) - 1, 2 * uniform(d, j + 2) - 1);
}
#endif

/* ---- functions performed apart for the lanes of each answer ---- */
namespace lanes
{
inline Answers answers_of(int bits)
{
    Answers all;
    for (int i = 0; i < WIDTH; i++) all[i] = -(int64_t)(bits >> i & 1);
    return all;
}

/* Returns the value of a function that writes nothing. Where lanes differ in a condition, the
 * function is performed once for the lanes with each answer, and the two values are blended. */
template <class T, class F> T performed_apart(const F &function);
template <class T, class F> INLINE T apart(F function)
{
    if constexpr (is_blended<T>()) return performed_apart<T>(function);
    else return function();
}
template <class T, class F> T performed_apart(const F &function)
{
    struct {
        F function;
        T found;
    } own = {function, {}};
    Split here;
    const auto call = [](void *given) {
        auto *all = (decltype(own) *)given;
        all->found = all->function();
    };
    if (performed(&here, call, &own)) return own.found;
    const int all = active;
    active = here.answer;
    const T first = performed_apart<T>(function);
    active = all & ~here.answer;
    const T second = performed_apart<T>(function);
    active = all;
    return blend(answers_of(here.answer), first, second);
}

/* Performs a function for the active lanes: once or, where lanes differ in a condition, once for
 * the lanes with each answer. x: pointers to all that the function writes. Returns true if lanes
 * differed. */
template <class F, class... X> bool perform_apart(const F &function, X *...x)
{
    const std::tuple<X...> before(*x...);
    const auto call = [](void *given) { (*(const F *)given)(); };
    Split here;
    if (performed(&here, call, (void *)&function)) return false;
    const int all = active;
    std::tie(*x...) = before;
    active = here.answer;
    perform_apart(function, x...);
    const std::tuple<X...> first(*x...);
    std::tie(*x...) = before;
    active = all & ~here.answer;
    perform_apart(function, x...);
    active = all;
    ((*x = blend(answers_of(here.answer), std::get<X>(first), *x)), ...);
    return true;
}

/* perform_apart() for those active lanes whose bits are set in `some`; x does not change in the
 * other lanes */
template <class F, class... X> void perform_for(int some, const F &function, X *...x)
{
    const std::tuple<X...> before(*x...);
    const int all = active;
    active = some;
    perform_apart(function, x...);
    active = all;
    ((*x = blend(answers_of(some), *x, std::get<X>(before))), ...);
}

/* type of pointers that point to one struct, never into an array, so that perform_for() can save
 * and blend this struct: a model declares single_object() for pointers to its State and to its
 * Output */
template <class T>
concept Single = requires(T pointer) { single_object(pointer); };
/* type of arguments through which a function cannot write: a number, a value that consists of
 * vectors, or a pointer to such a value that is constant */
template <class T>
concept NotWritten = Number<T> || is_blended<T>() ||
                     (std::is_pointer_v<T> && std::is_const_v<std::remove_pointer_t<T>> &&
                      is_blended<std::remove_cv_t<std::remove_pointer_t<T>>>());

template <class T> INLINE auto written(T argument)
{
    if constexpr (NotWritten<T>) return std::tuple<>();
    else return std::tuple<T>(argument);
}

/* `if (c) function(arguments);` of a model: performs the function for the lanes in which c is true;
 * `arguments` serve to find what the function writes. If one is neither NotWritten nor Single, all
 * lanes must agree in c. */
template <class C, class F, class... T> INLINE void where(C c, const F &function, T... arguments)
{
    if constexpr (Answer<C> && ((NotWritten<T> || Single<T>) && ...)) {
        const int some = Mask(c).bits();
        if (some == active) function();
        else if (some)
            std::apply([&](auto... x) { perform_for(some, function, x...); },
                       std::tuple_cat(written(arguments)...));
    } else if (c) function();
}

/* Performs a step of a component in all lanes. x: its state; y: its output; splits: 0
 * until one of its steps splits, then 1 plus the number of steps that split, the repeated first one
 * included. Saving x and y often takes longer than
 * the step, so they are saved before each step only after the first split. At the first split,
 * runs.h restores the memory of the whole system from its last copy and repeats the macro steps
 * made since that copy. */
template <class X, class Y>
void step_in_lanes(void (*step)(void *), void *given, X *x, Y *y, int64_t *splits)
{
    if (*splits == 0) {
        Split here;
        if (performed(&here, step, given)) return;
        *splits = 1;
        longjmp(again, 1);
    }
    *splits += perform_apart([=] { step(given); }, x, y);
}

/* ---- checks ---- */
inline int not_finite; /* bits of the lanes that have a state or output that is not finite */

inline Mask all_of(const Vector *x, size_t count)
{
    Mask valid = isfinite(x[0]);
    for (size_t i = 1; i < count; i++) valid = valid && isfinite(x[i]);
    return valid;
}

/* lanes in which all of x[0 .. count-1] are finite: a sum is finite only if every term is finite */
inline Mask all_finite(const Vector *x, size_t count)
{
    Vector sum[4] = {0, 0, 0, 0};
    size_t i = 0;
    for (; i + 4 <= count; i += 4)
        for (size_t k = 0; k < 4; k++) sum[k] += x[i + k];
    for (; i < count; i++) sum[0] += x[i];
    const Mask valid = isfinite((sum[0] + sum[1]) + (sum[2] + sum[3]));
    return valid.bits() == active ? valid : all_of(x, count);
}

/* Adds to not_finite the lanes in which a state or output of a component is not finite. Called
 * after each step of the component, because only steps change these values, and because they are
 * still in the cache then. */
template <class X, class Y> void check_finite(const X *x, const Y *y)
{
    const Mask valid = all_finite((const Vector *)x, sizeof *x / sizeof(Vector)) &&
                       all_finite((const Vector *)y, sizeof *y / sizeof(Vector));
    not_finite |= (!valid).bits();
}
} /* namespace lanes */

#define double lanes::Vector
#endif
