/* state.c - states of an instance and directional derivatives. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "state.h"

typedef struct {
    uint64_t model; /* fingerprint of the FMU in which the state can be restored */
    uint64_t sum;   /* checksum of progress and data */
    Progress now;
    double data[]; /* fmu_model.size bytes */
} Snapshot;

size_t snapshot_size(void) { return offsetof(Snapshot, data) + fmu_model.size; }
static uint64_t check_sum(const Snapshot *s)
{
    return fold(UINT64_C(14695981039346656037), &s->now, snapshot_size() - offsetof(Snapshot, now));
}

bool take_snapshot(const Instance *instance, void **state)
{
    Snapshot *s = *state ? *state : allocate(instance, snapshot_size());
    if (!s) return false;
    memset(
        s, 0,
        offsetof(Snapshot, data)); /* clears padding too, so that equal states have equal bytes */
    s->model = fingerprint(&fmu_model, 0);
    memcpy(&s->now, &instance->now, sizeof s->now);
    memcpy(s->data, instance->model, fmu_model.size);
    *state = s;
    return true;
}

void restore_snapshot(Instance *instance, const void *state)
{
    const Snapshot *s = state;
    memcpy(&instance->now, &s->now, sizeof s->now);
    memcpy(instance->model, s->data, fmu_model.size);
}

void write_snapshot(const void *state, void *bytes)
{
    uint64_t sum = check_sum(state);
    memcpy(bytes, state, snapshot_size());
    memcpy((char *)bytes + offsetof(Snapshot, sum), &sum, sizeof sum);
}

const char *read_snapshot(const Instance *instance, const void *bytes, size_t size, void **state)
{
    if (size != snapshot_size()) return "wrong number of bytes for this FMU";
    Snapshot *s = allocate(instance, size);
    if (!s) return "out of memory";
    memcpy(s, bytes, size);
    if (s->model != fingerprint(&fmu_model, 0) || s->sum != check_sum(s)) {
        release(instance, s);
        return "the bytes are damaged or belong to another FMU";
    }
    s->sum = 0;
    release(instance, *state);
    *state = s;
    return NULL;
}

/* ---- directional derivatives ----
 * After initialization: derivatives of the outputs at the end of the next step with respect to the
 * inputs, which are constant over the step. The next step is as long as the last one; before the
 * first step, 0.1 s; in a fused system, one macro step.
 * In initialization mode: derivatives of the outputs at the start time with respect to parameters
 * and inputs.
 * The knowns move by a distance d along the seed (ahead) and against it (behind). Central
 * differences at d and d/2 with Richardson extrapolation have an error of fourth order in d. At the
 * first d no known moves by more than 1 % of its scale; d is halved until two estimates agree, so
 * that a contact or a limit beside the operating point has no effect. Where the slopes ahead and
 * behind differ however small d is, the derivative is the slope ahead. */
static double next_step(const Instance *instance)
{
    if (fmu_model.macro_step) return fmu_model.macro_step(instance->model);
    return instance->now.step > 0 ? instance->now.step : 0.1;
}

/* evaluates a copy of the model with its knowns moved by `distance` along the seed; false: the
 * evaluation is rejected */
static bool evaluate_at(const Instance *instance, const Direction *d, double distance, void *copy)
{
    memcpy(copy, instance->model, fmu_model.size);
    for (size_t i = 0; i < d->knowns; i++)
        *pointer_to(copy, scalar_of(&fmu_model, d->known[i])) += distance * d->seed[i];
    if (instance->now.phase == INITIALIZING) return initialize_checked(instance, d->function, copy);
    return step_checked(instance, d->function, copy, instance->now.time, next_step(instance));
}

enum { MOST_HALVINGS = 16 };
/* agreement: largest difference between two estimates that agree; clear_bend: least difference
 * between the slopes ahead and behind that counts as a kink; both relative to `largest`
 * of the Slope */
static const double agreement = 1e-6;
static const double clear_bend = 1e-3;

/* finite differences of one unknown, from its values behind, here (operating point) and ahead */
typedef struct {
    double central, ahead; /* slopes: from behind to ahead, and from here to ahead */
    double bend;           /* slope from here to ahead minus slope from behind to here */
    double largest;        /* largest central slope among the elements of the unknown's row */
    double rounding;       /* rounding error to expect in a slope: 64 units in the last place */
} Slope;

/* state of the search for the derivative of one unknown; value: the unknown at the operating point;
 * first_bend: bend at the first distance; estimate: by Richardson extrapolation from the last two
 * distances; best: the estimate to return, so far the one that changed least when the distance was
 * halved; least_change: this change */
typedef struct {
    double value, first_bend, estimate, best, least_change;
    Slope slope, wider; /* at the shortest distance and at twice this distance */
    bool settled;
} Derivative;

static double largest_slope(Scalar s, const void *plus, const void *minus, double distance)
{
    double largest = 0;
    for (s.element = 0; s.element < s.row->size; s.element++)
        largest = larger(largest, fabs(value_of(plus, s) - value_of(minus, s)) / (2 * distance));
    return largest;
}

/* computes the slopes of all unknowns at a distance; magnitude: largest absolute value of a known,
 * to which the rounding error is proportional; false: an evaluation is rejected */
static bool measure_slopes(const Instance *instance, const Direction *d, double distance,
                           double magnitude, void *work, Derivative found[])
{
    char *plus = work, *minus = plus + memory_of(&fmu_model);
    if (!evaluate_at(instance, d, distance, plus) || !evaluate_at(instance, d, -distance, minus))
        return false;
    for (size_t i = 0; i < d->unknowns; i++) {
        Scalar s = scalar_of(&fmu_model, d->unknown[i]);
        double ahead = value_of(plus, s), here = found[i].value, behind = value_of(minus, s);
        double largest = largest_slope(s, plus, minus, distance);
        double unit = 64 * DBL_EPSILON * (fabs(here) + largest * magnitude);
        found[i].wider = found[i].slope;
        found[i].slope = (Slope){.central = (ahead - behind) / (2 * distance),
                                 .ahead = (ahead - here) / distance,
                                 .bend = (ahead - 2 * here + behind) / distance,
                                 .largest = largest,
                                 .rounding = unit / distance};
    }
    return true;
}

/* true if the slopes ahead and behind differ by about the same amount at all distances. When
 * the distance is halved, a difference due to curvature shrinks, and one due to rounding errors
 * grows. */
static bool has_kink(const Derivative *f)
{
    const double bend = fabs(f->slope.bend);
    return bend > clear_bend * f->slope.largest && bend > 8 * f->slope.rounding &&
           fabs(f->slope.bend - f->wider.bend) < 0.25 * bend && bend < 2 * fabs(f->first_bend);
}

/* sets `settled` if the last halving of the distance changed the estimate by no more than
 * `agreement` or the rounding error and there is no kink */
static void settle(Derivative *f, int halvings)
{
    const double before = f->estimate;
    if (halvings == 0) f->first_bend = f->slope.bend;
    if (halvings > 0) f->estimate = (4 * f->slope.central - f->wider.central) / 3;
    if (halvings < 2) return;
    const double change = fabs(f->estimate - before);
    if (halvings == 2 || change < f->least_change) {
        f->least_change = change;
        f->best = f->estimate;
    }
    f->settled = change <= larger(agreement * f->slope.largest, f->slope.rounding) && !has_kink(f);
    if (f->settled) f->best = before; /* from a longer distance: less rounding error */
}

RARE static void report_one_side(const Instance *instance, const Direction *d, size_t i)
{
    char name[NAME_SIZE], text[NAME_SIZE + 160];
    snprintf(text, sizeof text,
             "%s: %s has unequal one-sided slopes; the derivative is the slope along the seed",
             d->function, element_name(name, scalar_of(&fmu_model, d->unknown[i])));
    log_message(instance, STATUS_WARNING, LOG_WARNINGS, text);
}

static double largest_known(const Instance *instance, const Direction *d)
{
    double largest = 0;
    for (size_t i = 0; i < d->knowns; i++)
        if (d->seed[i] != 0)
            largest = larger(largest,
                             fabs(value_of(instance->model, scalar_of(&fmu_model, d->known[i]))));
    return largest;
}

/* finds the derivatives of all unknowns; distance: first distance along the seed; work: space for
 * two models; false: an evaluation is rejected */
static bool find_derivatives(const Instance *instance, const Direction *d, double distance,
                             void *work, Derivative found[])
{
    const double magnitude = largest_known(instance, d);
    size_t settled = 0;
    if (!evaluate_at(instance, d, 0, work)) return false;
    for (size_t i = 0; i < d->unknowns; i++)
        found[i] = (Derivative){.value = value_of(work, scalar_of(&fmu_model, d->unknown[i]))};
    for (int k = 0; k <= MOST_HALVINGS && settled < d->unknowns; k++, distance /= 2) {
        if (!measure_slopes(instance, d, distance, magnitude, work, found)) return false;
        for (size_t i = 0; i < d->unknowns; i++) {
            if (!found[i].settled) settle(&found[i], k);
            settled += found[i].settled;
        }
        if (settled < d->unknowns) settled = 0;
    }
    for (size_t i = 0; i < d->unknowns; i++) {
        if (found[i].settled || !has_kink(&found[i])) continue;
        found[i].best = 2 * found[i].slope.ahead - found[i].wider.ahead;
        report_one_side(instance, d, i);
    }
    return true;
}

/* scale of a known (the first move is at most 1 % of the scale): absolute value of a parameter; for
 * an input, or a parameter with the value 0, one unit, but at least 1e-6 of the value (more
 * than one unit for a position in N, which is larger than 1e6 m in an orbit) */
static double scale_of(Scalar s, double value)
{
    if (s.row->causality == PARAMETER_ROW && value != 0) return fabs(value);
    return larger(1, 1e-6 * fabs(value));
}

/* first distance along the seed: the largest at which no known moves by more than 1 % of its scale;
 * 0 for a zero seed */
static double difference_distance(const Instance *instance, const Direction *d)
{
    double distance = INFINITY;
    for (size_t i = 0; i < d->knowns; i++) {
        Scalar s = scalar_of(&fmu_model, d->known[i]);
        double scale = scale_of(s, value_of(instance->model, s));
        if (d->seed[i] != 0) distance = smaller(distance, 0.01 * scale / fabs(d->seed[i]));
    }
    return isfinite(distance) ? distance : 0;
}

static const char *why_no_derivative(const Instance *instance, const Direction *d)
{
    if ((d->unknowns && !d->unknown) || (d->knowns && (!d->known || !d->seed)))
        return "an array argument is NULL";
    for (size_t i = 0; i < d->unknowns; i++) {
        Scalar s = scalar_of(&fmu_model, d->unknown[i]);
        if (!s.row || s.row->causality != OUTPUT_ROW)
            return "an unknown is not an output of this FMU";
    }
    for (size_t i = 0; i < d->knowns; i++) {
        Scalar s = scalar_of(&fmu_model, d->known[i]);
        bool known =
            s.row && (s.row->causality == INPUT_ROW ||
                      (s.row->causality == PARAMETER_ROW && instance->now.phase == INITIALIZING));
        if (!known)
            return "a known is not an input (or, in initialization mode, a parameter) of this FMU";
        if (!isfinite(d->seed[i])) return "the seed of a known is not finite";
    }
    return NULL;
}

bool derive(const Instance *instance, const Direction *d, double sensitivity[])
{
    const char *rule = why_no_derivative(instance, d);
    if (too_many_substeps(&instance->now, next_step(instance)))
        rule = "the next step would take more than 1e7 internal steps";
    if (rule || (d->unknowns && !sensitivity))
        return reject_call(instance, d->function, rule ? rule : "an array argument is NULL");

    double distance = difference_distance(instance, d);
    for (size_t i = 0; i < d->unknowns; i++) sensitivity[i] = 0;
    if (distance == 0 || d->unknowns == 0) return true;

    Derivative *found = allocate(instance, d->unknowns * sizeof *found + 2 * memory_of(&fmu_model));
    if (!found) return reject_call(instance, d->function, "out of memory");
    bool good = find_derivatives(instance, d, distance, found + d->unknowns, found);
    for (size_t i = 0; i < d->unknowns && good; i++) sensitivity[i] = found[i].best;
    release(instance, found);
    return good;
}
