/*
 * A program of seatrial as a model of FMI: instances, values by reference, steps, state.
 * The generated fmu_names.h says which program it is and where its numbers stand. A standard's file includes this
 * one after it has said what Reference and Whole are; functions here return 1 where they could do what was asked.
 *
 * Numbers that are not finite are refused. What begins as infinity ("no bottom", "no sample yet") may be that again, and
 * an output may be infinite (the altitude over no bottom), but is always a number. A parameter lies in its range, and all of them together make constants that are finite: no vehicle of mass -5.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fmu_names.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* The most steps of one communication step: hours of work. */
#define MOST_STEPS 1e9

/* One instance: everything that it knows, in one piece, so that its state is its bytes. */
typedef struct
{
    MODEL_PARAMETERS own;    /* as they were set */
    MODEL_PARAMETERS p;      /* as they are used: those set, or a sample of the set in use */
    MODEL_CONSTANTS k;
    MODEL_STATE s;
    MODEL_INPUT in;
    MODEL_OUTPUT out;
    double time;
    int set;                 /* 0: the parameters that were set; else a sample of the covariance */
    int stale;               /* the parameters were changed since the constants were made */
    int sound;               /* the constants are finite */
} Instance;

#include "fmu_places.h"

/* Where the numbers of an instance stand, by value reference less one: parameters, inputs, outputs. */
static double *place(Instance *m, size_t reference)
{
    char *base = (char *)m;
    double *found = NULL;
    if ((reference >= 1u) && (reference <= N_NUMBERS))
    {
        found = (double *)(void *)(base + number_places[reference - 1u]);
    }
    return found;
}

static int is_parameter(size_t reference)
{
    return (reference >= 1u) && (reference <= N_PARAMETERS);
}

static int is_output(size_t reference)
{
    return (reference > (N_PARAMETERS + N_INPUTS)) && (reference <= N_NUMBERS);
}

/* Whether numbers are finite. */
static int finite(const double *x, size_t n)
{
    size_t i;
    int all = 1;
    for (i = 0u; i < n; i++)
    {
        all = all && isfinite(x[i]);
    }
    return all;
}

/* Whether an input may have a value: a finite one, or the infinity that it began with. */
static int may_be(size_t reference, double value)
{
    const double start = number_starts[reference - 1u];
    return isfinite(value) || (isinf(start) && (value == start));
}

static int settle(Instance *m)
{
    if (m->stale)
    {
        m->p = m->own;
#if N_SETS > 0
        if (m->set > 0)
        {
            size_t i;
            for (i = 0u; i < N_SAMPLED; i++)
            {
                *(double *)(void *)((char *)m + offsetof(Instance, p) + sampled_places[i]) =
                    samples[(size_t)(m->set - 1) * N_SAMPLED + i];
            }
        }
#endif
        MODEL(prepare)(&m->p, &m->k);
        m->stale = 0;
        m->sound = finite((const double *)(const void *)&m->k, sizeof m->k / sizeof(double));
    }
    return m->sound;
}

static void reset(Instance *m)
{
    memset(m, 0, sizeof *m);
    MODEL(defaults)(&m->own);
    MODEL(begin)(&m->s, &m->in);
    m->stale = 1;
    output_starts(&m->out);
}

static Instance *instantiate(void)
{
    Instance *m = (Instance *)calloc(1u, sizeof(Instance));
    if (m != NULL)
    {
        reset(m);
    }
    return m;
}

static int show(Instance *m)
{
    const int sound = settle(m);
#if MEASURED
    MODEL(measure)(&m->p, &m->k, &m->s, &m->in, &m->out);
#endif
    return sound;
}

/* Whether all that the model knows and tells is a number. */
static int sound(const Instance *m)
{
    size_t i;
    int all = m->sound && isfinite(m->time);
#if MEASURED
    all = all && finite((const double *)(const void *)&m->s, sizeof m->s / sizeof(double));
#endif
    for (i = N_PARAMETERS; i < N_NUMBERS; i++)
    {
        all = all && !isnan(*(const double *)(const void *)((const char *)m + number_places[i]));
    }
    return all;
}

/* The number of steps that make a communication step; 0 where none do. */
static long steps_in(double size)
{
    const double ratio = size / STEP_S;
    const double whole = floor(ratio + 0.5);
    return ((whole >= 1.0) && (whole <= MOST_STEPS) && (fabs(ratio - whole) <= 1e-6 * whole)) ? (long)whole : 0L;
}

/* Whether a time is that of the instance, but for the rounding of whoever counts steps. */
static int is_now(const Instance *m, double now)
{
    return fabs(now - m->time) <= (1e-3 * STEP_S) + (1e-9 * fabs(m->time));
}

static int begin_at(Instance *m, double start)
{
    const int fits = isfinite(start) != 0;
    if (fits)
    {
        m->time = start;
    }
    return fits;
}

static int advance(Instance *m, double now, double size)
{
    long left = steps_in(size);
    int fits = settle(m) && is_now(m, now) && (left > 0L);
    for (left = fits ? left : 0L; left > 0L; left--)
    {
#if MEASURED
        MODEL(step)(&m->p, &m->k, &m->s, &m->in);
#else
        MODEL(step)(&m->p, &m->k, &m->s, &m->in, &m->out);
#endif
    }
    if (fits)
    {
        m->time += size;
        (void)show(m);
        fits = sound(m);
    }
    return fits;
}

static int get_real(Instance *m, size_t reference, double *value)
{
    const double *from = NULL;
    int known = 1;
    if (reference == 0u)
    {
        *value = m->time;
    }
    else
    {
        if (is_output(reference))
        {
            known = show(m);
        }
        from = place(m, reference);
        known = known && (from != NULL);
        if (known)
        {
            *value = *from;
        }
    }
    return known;
}

static int set_real(Instance *m, size_t reference, double value)
{
    double *to = place(m, reference);
    int may = (to != NULL) && !is_output(reference);
    if (may && is_parameter(reference))
    {
        /* false for what is no number */
        may = (value >= parameter_ranges[reference - 1u][0]) && (value <= parameter_ranges[reference - 1u][1]);
        if (may)
        {
            *to = value;
            m->stale = 1;
        }
    }
    else if (may)
    {
        may = may_be(reference, value);
        if (may)
        {
            *to = value;
        }
    }
    return may;
}

static int get_integer(const Instance *m, size_t reference, Whole *value)
{
    *value = m->set;
    return (reference == REFERENCE_OF_SET) && (N_SETS > 0);
}

static int set_integer(Instance *m, size_t reference, int value)
{
    const int may = (reference == REFERENCE_OF_SET) && (value >= 0) && (value <= N_SETS) && (N_SETS > 0);
    if (may)
    {
        m->set = value;
        m->stale = 1;
    }
    return may;
}

static int get_reals(void *c, const Reference r[], size_t n, double value[])
{
    size_t i;
    int all = 1;
    for (i = 0u; all && (i < n); i++)
    {
        all = get_real((Instance *)c, r[i], &value[i]);
    }
    return all;
}

static int set_reals(void *c, const Reference r[], size_t n, const double value[])
{
    size_t i;
    int all = 1;
    for (i = 0u; all && (i < n); i++)
    {
        all = set_real((Instance *)c, r[i], value[i]);
    }
    return all;
}

static int get_integers(const void *c, const Reference r[], size_t n, Whole value[])
{
    size_t i;
    int all = 1;
    for (i = 0u; all && (i < n); i++)
    {
        all = get_integer((const Instance *)c, r[i], &value[i]);
    }
    return all;
}

static int set_integers(void *c, const Reference r[], size_t n, const Whole value[])
{
    size_t i;
    int all = 1;
    for (i = 0u; all && (i < n); i++)
    {
        all = set_integer((Instance *)c, r[i], value[i]);
    }
    return all;
}

/* An instance of the program that the token names, or none. */
static void *created(const char *token)
{
    return ((token != NULL) && (strcmp(token, TOKEN) == 0)) ? (void *)instantiate() : NULL;
}

/* Bytes of an instance as a kept state; memory for it where there is none yet. */
static int keep_state(const void *from, void **state)
{
    if (*state == NULL)
    {
        *state = malloc(sizeof(Instance));
    }
    if (*state != NULL)
    {
        memcpy(*state, from, sizeof(Instance));
    }
    return *state != NULL;
}

static void free_state(void **state)
{
    free(*state);
    *state = NULL;
}

/* The state goes back into an instance, where there is one. */
static int restore_state(void *to, const void *state)
{
    if (state != NULL)
    {
        memcpy(to, state, sizeof(Instance));
    }
    return state != NULL;
}

/* FNV-1a over the bytes of a state and the token: another program's or a damaged state has another. */
static uint64_t checksum(const unsigned char *bytes)
{
    const char *letter;
    uint64_t sum = 14695981039346656037u;
    size_t i;
    for (i = 0u; i < sizeof(Instance); i++)
    {
        sum = (sum ^ bytes[i]) * 1099511628211u;
    }
    for (letter = TOKEN; *letter != '\0'; letter++)
    {
        sum = (sum ^ (unsigned char)*letter) * 1099511628211u;
    }
    return sum;
}

#define SERIALISED (sizeof(Instance) + sizeof(uint64_t))

static int serialise_state(const void *state, void *bytes, size_t size)
{
    const int fits = (state != NULL) && (size >= SERIALISED);
    if (fits)
    {
        const uint64_t sum = checksum((const unsigned char *)state);
        memcpy(bytes, state, sizeof(Instance));
        memcpy((char *)bytes + sizeof(Instance), &sum, sizeof sum);
    }
    return fits;
}

static int deserialise_state(const void *bytes, size_t size, void **state)
{
    uint64_t sum = 0u;
    int fits = (size == SERIALISED);
    if (fits)
    {
        memcpy(&sum, (const char *)bytes + sizeof(Instance), sizeof sum);
        fits = (sum == checksum((const unsigned char *)bytes)) && keep_state(bytes, state);
    }
    return fits;
}
