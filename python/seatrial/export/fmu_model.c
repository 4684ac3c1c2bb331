/*
 * A program of seatrial as a model of FMI: instances, values by reference, steps, state.
 * The generated fmu_names.h says which program it is and where its numbers stand. A standard's file includes this
 * one after it has said what Reference and Whole are; functions here return 1 where they could do what was asked.
 */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "fmu_names.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

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

static void settle(Instance *m)
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
    }
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

static void show(Instance *m)
{
    settle(m);
#if MEASURED
    MODEL(measure)(&m->p, &m->k, &m->s, &m->in, &m->out);
#endif
}

/* The number of steps that make a communication step; 0 where none do. */
static long steps_in(double size)
{
    const double ratio = size / STEP_S;
    const double whole = floor(ratio + 0.5);
    return ((whole >= 1.0) && (fabs(ratio - whole) <= 1e-6 * whole)) ? (long)whole : 0L;
}

static int advance(Instance *m, double size)
{
    long left = steps_in(size);
    const int fits = (left > 0L);
    settle(m);
    for (; left > 0L; left--)
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
        show(m);
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
            show(m);
        }
        from = place(m, reference);
        known = (from != NULL);
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
    const int may = (to != NULL) && !is_output(reference);
    if (may)
    {
        *to = value;
        if (is_parameter(reference))
        {
            m->stale = 1;
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

static int serialise_state(const void *state, void *bytes, size_t size)
{
    const int fits = (size >= sizeof(Instance));
    if (fits)
    {
        memcpy(bytes, state, sizeof(Instance));
    }
    return fits;
}

static int deserialise_state(const void *bytes, size_t size, void **state)
{
    return (size == sizeof(Instance)) && keep_state(bytes, state);
}
