/* What a scalar says against what was expected of it: the normalised innovation squared. */
static real innovate(const FILTER_state *s, const struct row *row, real residual, real variance, real seen[STATES],
    real *value, real *spread_of)
{
    int i;
    int j;
    for (j = 0; j < STATES; j++)
    {
        seen[j] = R(0.0);
    }
    for (i = 0; i < STATES; i++)
    {
        const int end = (((row->parts >> (i / 3)) & 1u) != 0u) ? STATES : 0;
        for (j = 0; j < end; j++)
        {
            seen[j] += row->h[i] * s->covariance[i][j];
        }
    }
    *value = residual - times(row, s->error);
    *spread_of = times(row, seen) + variance;
    return (*value * *value) / *spread_of;
}

/* Takes a scalar, in the form of Joseph: P <- (I - K h) P (I - K h)' + K r K'. */
static void update(FILTER_state *s, const struct row *row, real variance, const real seen[STATES], real value, real spread_of)
{
    const real scale = R(1.0) / spread_of;
    const real shown = times(row, seen) + variance;
    int i;
    int j;
    for (i = 0; i < STATES; i++)
    {
        const real gain = seen[i] * scale;
        const real taken = gain + ((seen[i] - (gain * shown)) * scale);
        s->error[i] += gain * value;
        for (j = 0; j < STATES; j++)
        {
            s->covariance[i][j] -= taken * seen[j];
        }
    }
}

/* Takes or refuses a scalar. A sensor that is refused without a break for longer than the patience is believed again: the
   filter forgets what it shows, as far as the sample asks for. */
static void judge(const FILTER_parameters *p, FILTER_state *s, FILTER_watch *watch, const struct row *row, real residual,
    real variance)
{
    real seen[STATES];
    real value;
    real spread_of;
    const real normalised = innovate(s, row, residual, variance, seen, &value, &spread_of);
    const real silence = (s->time - watch->last) - (PAUSE * watch->gap);
    watch->recent += (SMALLER(normalised, COUNTS) - watch->recent) * FORGETS;
    if (silence > R(0.0))
    {
        watch->since += silence;
    }
    watch->gap = s->time - watch->last;
    watch->last = s->time;
    if (normalised <= (p->gate * p->gate))
    {
        update(s, row, variance, seen, value, spread_of);
        watch->taken++;
        watch->sum += normalised;
        watch->in_a_row = 0u;
        return;
    }
    if (watch->in_a_row == 0u)
    {
        watch->since = s->time;
    }
    if (!is_number(normalised) || ((s->time - watch->since) < p->patience) || (watch->in_a_row < 4u))
    {
        watch->refused++;
        watch->in_a_row++;
        return;
    }
    {
        const real length = times(row, row->h);
        const real scale = (value * value) / LARGER(length * length, SMALLEST);
        int i;
        int j;
        for (i = 0; i < STATES; i++)
        {
            for (j = 0; j < STATES; j++)
            {
                s->covariance[i][j] += (row->h[i] * row->h[j]) * scale;
            }
        }
    }
    (void)innovate(s, row, residual, variance, seen, &value, &spread_of);
    update(s, row, variance, seen, value, spread_of);
    watch->recovered++;
    watch->in_a_row = 0u;
}

//if place
/* The axis of a fix whose constant offset counts as its error, because other fixes do not share it; or -1. */
static int shifted(const FILTER_parameters *p, const FILTER_state *s, int channel)
{
    int axis = -1;
    real bias = R(0.0);
//if landmarks
    const int several = 1;
//end
//if alone
    const int several = (s->watch[18].taken > 0u) ? 1 : 0;
//end
    (void)s;
    (void)p;
    switch (channel)
    {
@SHIFTED@    default:
        break;
    }
    return ((several != 0) && (bias > R(0.0))) ? axis : -1;
}

//end
/* Takes or refuses what a channel shows; the sample is so old. */
static void take(const FILTER_parameters *p, const FILTER_constants *k, FILTER_state *s, const FILTER_instrument *by,
    int channel, real value, const FILTER_mean *at, int back, real share)
{
    struct row row;
    real expected = R(0.0);
    real residual;
    real variance = LARGER(by->noise * by->noise, R(1e-12));
    if (!is_number(value))
    {
        return;
    }
    s->silent[channel] = R(0.0);
    s->first[channel] = value;
    if ((s->begun == 0) || (at == 0))
    {
        return;
    }
//if place
    {
        const int axis = shifted(p, s, channel);
        if (axis >= 0)
        {
            if (s->covariance[POSITION + axis][POSITION + axis] <= (by->bias * by->bias))
            {
                return;
            }
            variance += by->bias * by->bias;
        }
    }
//end
    if (expect(p, k, s, channel, at, &expected, &row) == 0)
    {
        return;
    }
    residual = value - expected;
    if (IS_ANGLE(channel))
    {
        residual = wrapped(residual);
    }
//if past
    if (back >= 0)
    {
        residual -= brought_here(k, s, back, share, &row);
    }
//end
    (void)back;
    (void)share;
    judge(p, s, &s->watch[channel], &row, residual, variance);
}

/* Takes or refuses the samples of a sensor: as many channels from the first on. What is older than what is kept is not
   taken. */
static void sense(const FILTER_parameters *p, const FILTER_constants *k, FILTER_state *s, const FILTER_instrument *by,
    int first, int count, const real *values, real age)
{
    const FILTER_mean *at = &s->mean;
    int back = -1;
    real share = R(0.0);
    int i;
//if past
    FILTER_mean then;
    age += by->latency;
    if ((s->begun != 0) && (age >= (SLACK * PERIOD)))
    {
        at = (between(s, s->time - age, &then, &back, &share) != 0) ? &then : 0;
    }
//end
//if prompt
    if ((by->latency + age) >= (SLACK * PERIOD))
    {
        at = 0;
    }
//end
    for (i = 0; i < count; i++)
    {
        take(p, k, s, by, first + i, values[i], at, back, share);
    }
}

/* The largest of three standard deviations. */
static real largest(const FILTER_state *s, int first)
{
    real most = R(0.0);
    int i;
    for (i = first; i < (first + 3); i++)
    {
        most = LARGER(most, SQRT(LARGER(s->covariance[i][i], R(0.0))));
    }
    return most;
}
