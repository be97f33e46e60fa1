/* state.c - states of an instance and directional derivatives. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "state.h"

typedef struct {
    uint64_t model; /* fingerprint: a state belongs to this FMU and no other */
    uint64_t sum;   /* over progress and data: damaged bytes are refused */
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
    memset(s, 0, offsetof(Snapshot, data)); /* padding too: equal states have equal bytes */
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
 * After initialization: of the outputs at the end of the next step (of the size of the last one,
 * 0.1 s before the first) with respect to the inputs held over it. In initialization mode: of the
 * first outputs with respect to parameters and inputs. Central differences at d and d/2 with
 * Richardson extrapolation, so the error is of fourth order in d. */
static double next_step(const Instance *instance)
{
    if (fmu_model.macro_step) return fmu_model.macro_step(instance->model);
    return instance->now.step > 0 ? instance->now.step : 0.1;
}

/* a copy of the model at the operating point moved by `distance` along the seed, evaluated */
static bool evaluate_at(const Instance *instance, const Direction *d, double distance, void *copy)
{
    memcpy(copy, instance->model, fmu_model.size);
    for (size_t i = 0; i < d->knowns; i++)
        *pointer_to(copy, scalar_of(&fmu_model, d->known[i])) += distance * d->seed[i];
    if (instance->now.phase == INITIALIZING) return initialize_checked(instance, d->function, copy);
    return step_checked(instance, d->function, copy, instance->now.time, next_step(instance));
}

static bool central_difference(const Instance *instance, const Direction *d, double distance,
                               void *work, double *result)
{
    char *plus = work, *minus = plus + memory_of(&fmu_model);
    if (!evaluate_at(instance, d, distance, plus) || !evaluate_at(instance, d, -distance, minus))
        return false;
    for (size_t i = 0; i < d->unknowns; i++) {
        Scalar s = scalar_of(&fmu_model, d->unknown[i]);
        result[i] = (value_of(plus, s) - value_of(minus, s)) / (2 * distance);
    }
    return true;
}

/* how far a variable may be moved: one unit, more for a position in N; a parameter by a part of its
 * value */
static double scale_of(Scalar s, double value)
{
    if (s.row->causality == PARAMETER_ROW && value != 0) return fabs(value);
    return larger(1, 1e-6 * fabs(value));
}

/* until the first known has moved by 1 % of its scale; 0 for a zero seed */
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
        return "missing array";
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
        if (!isfinite(d->seed[i])) return "the direction must be finite";
    }
    return NULL;
}

bool derive(const Instance *instance, const Direction *d, double sensitivity[])
{
    const char *rule = why_no_derivative(instance, d);
    if (too_many_substeps(&instance->now, next_step(instance)))
        rule = "the next step would take more than 1e7 internal steps";
    if (rule || (d->unknowns && !sensitivity))
        return refuse_call(instance, d->function, rule ? rule : "missing array");

    double distance = difference_distance(instance, d);
    for (size_t i = 0; i < d->unknowns; i++) sensitivity[i] = 0;
    if (distance == 0 || d->unknowns == 0) return true;

    double *half = allocate(instance, d->unknowns * sizeof(double) + 2 * memory_of(&fmu_model));
    if (!half) return refuse_call(instance, d->function, "out of memory");
    bool good = central_difference(instance, d, distance, half + d->unknowns, sensitivity) &&
                central_difference(instance, d, distance / 2, half + d->unknowns, half);
    for (size_t i = 0; i < d->unknowns && good; i++)
        sensitivity[i] = (4 * half[i] - sensitivity[i]) / 3;
    release(instance, half);
    return good;
}
