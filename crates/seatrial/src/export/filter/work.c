/* The place of a fix, without its lever arm, where there was one. */
static int fixed(const FILTER_state *s, const FILTER_instrument *by, int channel, int axis, real r[3][3], FILTER_mean *at,
    real *deviation)
{
    if (!is_number(s->first[channel]))
    {
        return 0;
    }
    at->position[axis] = s->first[channel] - dot(r[axis], by->arm);
    *deviation = LARGER(SQRT((by->noise * by->noise) + (by->bias * by->bias)), R(1e-6));
    return 1;
}

/* Takes what a sensor of velocity or rates has shown before the filter began. */
static void begin_with(const FILTER_parameters *p, const FILTER_constants *k, FILTER_state *s, const FILTER_instrument *by,
    int channel)
{
    const real moves = ((channel >= 9) && (channel < 12)) ? UNKNOWN_RATE : UNKNOWN_SPEED;
    const real old = SMALLER(s->silent[channel] + by->latency, R(1.0)) * moves;
    const real variance = (old * old) + LARGER(by->noise * by->noise, R(1e-12));
    struct row row;
    real seen[STATES];
    real expected = R(0.0);
    real value;
    real spread_of;
    if (!is_number(s->first[channel]) || (expect(p, k, s, channel, &s->mean, &expected, &row) == 0))
    {
        return;
    }
    (void)innovate(s, &row, s->first[channel] - expected, variance, seen, &value, &spread_of);
    update(s, &row, variance, seen, value, spread_of);
}

/* Begins when the attitude is known. */
static void try_to_begin(const FILTER_parameters *p, const FILTER_constants *k, FILTER_state *s)
{
    const real inverse[4] = { k->facing[0], -k->facing[1], -k->facing[2], -k->facing[3] };
    FILTER_mean at;
    real deviations[STATES];
    real q[4];
    real r[3][3];
    int i;
    int j;
    if (!(is_number(s->first[3]) && is_number(s->first[4]) && is_number(s->first[5])))
    {
        return;
    }
    from_euler(&s->first[3], q);
    quaternion_product(q, inverse, at.attitude);
    rotation(at.attitude, r);
    for (i = 0; i < 3; i++)
    {
        const int launched = is_number(s->far[i]) ? 0 : 1;
        real far = (launched != 0) ? p->start_deviation : s->far[i];
        int known = 0;
        at.position[i] = (launched != 0) ? p->start[i] : s->place[i];
        at.nu[i] = R(0.0);
        at.nu[3 + i] = R(0.0);
        at.force[i] = R(0.0);
        at.force[3 + i] = R(0.0);
        at.current[i] = R(0.0);
        at.gyro_bias[i] = R(0.0);
        if (i == 2)
        {
@FIXED_DEPTH@        }
        else
        {
@FIXED@        }
        (void)known;
        deviations[POSITION + i] = far;
        deviations[ATTITUDE + i] = LARGER(
            SQRT((p->attitude.noise * p->attitude.noise) + (p->attitude.bias * p->attitude.bias)), R(1e-6));
        deviations[VELOCITY + i] = UNKNOWN_SPEED;
        deviations[RATES + i] = UNKNOWN_RATE;
        deviations[CURRENT + i] = p->current[i];
        deviations[GYRO + i] = R(0.0);
//if gyro
        deviations[GYRO + i] = p->gyro.bias;
//end
        deviations[FORCE + i] = p->force[i];
        deviations[FORCE + 3 + i] = p->force[3 + i];
        if (is_number(s->first[MOVING + i]))
        {
            at.nu[i] = s->first[MOVING + i];
        }
        if (is_number(s->first[9 + i]))
        {
            at.nu[3 + i] = s->first[9 + i];
        }
    }
    for (i = FORCE + 3; i < (FORCE + 5); i++)
    {
        const real leaning = p->attitude.bias * RIGHTING;
        deviations[i] = SQRT((deviations[i] * deviations[i]) + (leaning * leaning));
    }
    s->mean = at;
    for (i = 0; i < STATES; i++)
    {
        for (j = 0; j < STATES; j++)
        {
            s->covariance[i][j] = (i == j) ? (deviations[i] * deviations[i]) : R(0.0);
        }
        s->error[i] = R(0.0);
    }
    s->begun = 1;
    s->age = R(0.0);
    s->doubted = R(0.0);
    for (i = 0; i < FILTER_CHANNELS; i++)
    {
        s->watch[i].recent = R(1.0);
    }
    for (i = 0; i < 3; i++)
    {
//if dvl
        begin_with(p, k, s, &p->dvl, 6 + i);
//end
    }
    for (i = 0; i < 3; i++)
    {
//if gyro
        begin_with(p, k, s, &p->gyro, 9 + i);
//end
    }
    for (i = 0; i < 3; i++)
    {
//if dvl_water
        begin_with(p, k, s, &p->dvl_water, 13 + i);
//end
    }
    (void)inject(&s->mean, s->error);
    for (i = 0; i < STATES; i++)
    {
        s->error[i] = R(0.0);
    }
//if past
    s->count = 0;
    keep(s, s->error);
//end
}

/* The estimated position is where the filter will begin, after a time of which nothing is known. */
static void stay(FILTER_state *s, real unknown)
{
    const real drifted = UNKNOWN_SPEED * unknown;
    int i;
    for (i = 0; i < 3; i++)
    {
        const real variance = s->covariance[POSITION + i][POSITION + i] + (drifted * drifted);
        if (is_number(s->mean.position[i]) && is_number(variance))
        {
            s->place[i] = s->mean.position[i];
            s->far[i] = SQRT(LARGER(variance, R(0.0)));
        }
    }
}

/* Begins anew where the innovations of two instruments are beyond all chance for long enough and the attitude is that of
   now. */
static void regain(const FILTER_parameters *p, const FILTER_constants *k, FILTER_state *s)
{
    static const int boxes[21] = { 0, 0, 1, 2, 2, 2, 3, 3, 3, 2, 2, 2, 4, 3, 3, 3, 0, 0, 0, 0, 0 };
    /* A sum of periods reaches a limit half a period early: its last digit would else decide the period. */
    const FILTER_real half = R(0.5) * PERIOD;
    int wild[6] = { 0, 0, 0, 0, 0, 0 };
    int count = 0;
    int i;
    for (i = 0; i < FILTER_CHANNELS; i++)
    {
        if (s->watch[i].recent > LOST)
        {
            wild[(i < 21) ? boxes[i] : 5] = 1;
        }
    }
    for (i = 0; i < 6; i++)
    {
        count += wild[i];
    }
    s->doubted = ((s->begun != 0) && (count > 1)) ? (s->doubted + PERIOD) : R(0.0);
    if ((s->doubted <= (DOUBTED - half)) || (s->age <= (s->patience - half))
        || (LARGER(LARGER(s->silent[3], s->silent[4]), s->silent[5]) >= (RECENT + half)))
    {
        return;
    }
    s->restarts++;
    s->patience = SMALLER(s->patience * R(2.0), LONGEST_PATIENCE);
    stay(s, UNNOTICED);
    for (i = 0; i < FILTER_CHANNELS; i++)
    {
        if (s->silent[i] > (RECENT + half))
        {
            s->first[i] = R(NAN);
        }
    }
    try_to_begin(p, k, s);
}

/* What is lost begins anew from the next samples. */
static void lose(FILTER_state *s)
{
    int i;
    stay(s, R(0.0));
    s->begun = 0;
    s->restarts++;
    for (i = 0; i < FILTER_CHANNELS; i++)
    {
        s->first[i] = R(NAN);
    }
}

void FILTER_defaults(FILTER_parameters *p)
{
@DEFAULTS@}

void FILTER_prepare(const FILTER_parameters *p, FILTER_constants *k)
{
    real q[4];
    int i;
    for (i = 0; i < STATES; i++)
    {
        k->noise[i] = R(0.0);
    }
    for (i = 0; i < 6; i++)
    {
        k->noise[VELOCITY + i] = (p->acceleration[i] * p->acceleration[i]) * PERIOD;
        k->kept[i] = EXP(-PERIOD / p->force_time[i]);
        k->noise[FORCE + i] = (p->force[i] * p->force[i]) * (R(1.0) - (k->kept[i] * k->kept[i]));
    }
    for (i = 0; i < 3; i++)
    {
        k->slow[i] = EXP(-PERIOD / p->current_time[i]);
        k->noise[CURRENT + i] = (p->current[i] * p->current[i]) * (R(1.0) - (k->slow[i] * k->slow[i]));
        k->noise[GYRO + i] = (p->gyro_walk * p->gyro_walk) * PERIOD;
    }
@MOUNTED@    from_euler(p->attitude.mount, k->facing);
}

void FILTER_begin(FILTER_state *s, FILTER_input *in)
{
    int i;
    int j;
    for (i = 0; i < 3; i++)
    {
        s->mean.position[i] = R(0.0);
        s->mean.current[i] = R(0.0);
        s->mean.gyro_bias[i] = R(0.0);
        s->place[i] = R(0.0);
        s->far[i] = R(NAN);
    }
    for (i = 0; i < 6; i++)
    {
        s->mean.nu[i] = R(0.0);
        s->mean.force[i] = R(0.0);
    }
    for (i = 0; i < 4; i++)
    {
        s->mean.attitude[i] = (i == 0) ? R(1.0) : R(0.0);
    }
    for (i = 0; i < STATES; i++)
    {
        for (j = 0; j < STATES; j++)
        {
            s->covariance[i][j] = R(0.0);
        }
        s->error[i] = R(0.0);
    }
    for (i = 0; i < FILTER_CHANNELS; i++)
    {
        s->first[i] = R(NAN);
        s->silent[i] = R(INFINITY);
        s->watch[i].sum = R(0.0);
        s->watch[i].recent = R(1.0);
        s->watch[i].since = R(0.0);
        s->watch[i].last = -LONG;
        s->watch[i].gap = R(0.0);
        s->watch[i].taken = 0u;
        s->watch[i].refused = 0u;
        s->watch[i].recovered = 0u;
        s->watch[i].in_a_row = 0u;
    }
//if surface
    for (i = 0; i < FILTER_MARKS; i++)
    {
        s->beam[i] = R(0.0);
    }
//end
//if past
    s->newest = 0;
    s->count = 0;
    for (i = 0; i < MOTION; i++)
    {
        for (j = 0; j < COLUMNS; j++)
        {
            s->back[i][j] = (i == (j + ATTITUDE)) ? R(1.0) : R(0.0);
        }
    }
    for (i = 0; i < 3; i++)
    {
        for (j = 0; j < 3; j++)
        {
            s->swept[i][j] = R(0.0);
        }
    }
//end
    s->time = R(0.0);
    s->age = R(0.0);
    s->doubted = R(0.0);
    s->patience = PATIENCE;
    s->begun = 0;
    s->open = 0;
    s->restarts = 0u;
@MOTORS_AT_REST@}

void FILTER_predict(const FILTER_parameters *p, const FILTER_constants *k, FILTER_state *s,
    const FILTER_input *in)
{
    real block[MOTION][COLUMNS];
    real decay[STATES];
    real noise[STATES];
    real r[3][3];
    real ground[3];
    real swept[3][3];
    real carried = R(0.0);
    int i;
    int j;
    if (s->open != 0)
    {
        (void)FILTER_settle(p, k, s);
    }
    s->open = 1;
    s->age += PERIOD;
    for (i = 0; i < FILTER_CHANNELS; i++)
    {
        s->silent[i] += PERIOD;
    }
    pass(s, in, block);
@SHOWN@    if (s->begun == 0)
    {
        return;
    }
    s->time += PERIOD;
    if (s->time > LONG)
    {
        s->time -= LONG;
        for (i = 0; i < FILTER_CHANNELS; i++)
        {
            s->watch[i].since -= LONG;
            s->watch[i].last -= LONG;
        }
//if past
        for (i = 0; i < KEPT; i++)
        {
            s->past[i].time -= LONG;
        }
//end
    }
    /* Constant offsets of attitude and Doppler log carry the position off; offsets of the attitude turn with the vehicle. */
    rotation(s->mean.attitude, r);
    turn_back(r, s->mean.current, ground);
    for (i = 0; i < 3; i++)
    {
        ground[i] += s->mean.nu[i];
        carried += ground[i] * ground[i];
    }
    carried *= p->attitude.bias * p->attitude.bias;
//if dvl
    carried += p->dvl.bias * p->dvl.bias;
//end
    for (i = 0; i < STATES; i++)
    {
        decay[i] = (i < FORCE) ? R(1.0) : ((i < CURRENT) ? k->kept[i - FORCE] : ((i < GYRO) ? k->slow[i - CURRENT] : R(1.0)));
        noise[i] = k->noise[i];
    }
    for (i = 0; i < 3; i++)
    {
        const real one = s->mean.nu[3 + ((i + 1) % 3)] * p->attitude.bias;
        const real other = s->mean.nu[3 + ((i + 2) % 3)] * p->attitude.bias;
        noise[POSITION + i] = carried * PERIOD;
        noise[ATTITUDE + i] = ((one * one) + (other * other)) * PERIOD;
        s->mean.current[i] *= k->slow[i];
    }
    for (i = 0; i < 6; i++)
    {
        s->mean.force[i] *= k->kept[i];
    }
    for (i = 0; i < 3; i++)
    {
        for (j = 0; j < 3; j++)
        {
            swept[i][j] = (r[i][j] * p->water[j]) * PERIOD;
            s->mean.current[i] += swept[i][j] * s->mean.force[j];
//if past
            s->swept[i][j] = swept[i][j];
//end
        }
    }
    spread(s->covariance, block, decay, noise, swept);
//if past
    reverse(block, k->kept, s->back);
//end
}

@SENSING@int FILTER_settle(const FILTER_parameters *p, const FILTER_constants *k, FILTER_state *s)
{
    int sound;
    int i;
    s->open = 0;
    if (s->begun == 0)
    {
        try_to_begin(p, k, s);
        return s->begun;
    }
    sound = inject(&s->mean, s->error);
//if past
    keep(s, s->error);
//end
    for (i = 0; i < STATES; i++)
    {
        s->error[i] = R(0.0);
        sound = sound && (s->covariance[i][i] >= R(0.0));
    }
    for (i = 0; i < 6; i++)
    {
        sound = sound && is_number(s->mean.nu[i]) && is_number(s->mean.force[i]) && is_number(s->mean.position[i % 3])
            && is_number(s->mean.attitude[i % 4]);
    }
    if (sound == 0)
    {
        lose(s);
    }
    regain(p, k, s);
    return s->begun;
}

/* The constant offset of a channel's sensor; infinite where none is known. */
static real offset(const FILTER_parameters *p, const FILTER_state *s, const FILTER_instrument *by, int channel)
{
//if place
    if (shifted(p, s, channel) >= 0)
    {
        return R(0.0);
    }
//end
    (void)p;
    return (s->watch[channel].taken > 0u) ? by->bias : R(INFINITY);
}

/* The deviation with a constant offset that is known. */
static real together(real deviation, real bias)
{
    return is_number(bias) ? SQRT((deviation * deviation) + (bias * bias)) : deviation;
}

/* The age of what is trusted; else of the last sample of its own sensor. */
static real age_of(const FILTER_state *s, int trusted, int channel, real latency)
{
    return (trusted != 0) ? R(0.0) : (s->silent[channel] + latency);
}

int FILTER_estimate(const FILTER_parameters *p, const FILTER_state *s, FILTER_output *out)
{
    const FILTER_mean *at = &s->mean;
    real channels[16];
    real r[3][3];
    int fresh[16];
    int i;
    rotation(at->attitude, r);
    turn_back(r, at->current, &channels[6]);
    for (i = 0; i < 3; i++)
    {
        channels[i] = at->position[i];
        channels[3 + i] = euler_angle(r, i);
        channels[6 + i] += at->nu[i];
        channels[9 + i] = at->nu[3 + i];
        channels[13 + i] = at->nu[i];
    }
    channels[12] = R(0.0);
    for (i = 0; i < STATES; i++)
    {
        out->deviation[i] = SQRT(LARGER(s->covariance[i][i], R(0.0)));
    }
    {
        const real a = s->covariance[0][0];
        const real b = s->covariance[0][1];
        const real d = s->covariance[1][1];
        const real wide = SQRT(((R(0.25) * (a - d)) * (a - d)) + (b * b));
        const int placed = SQRT(LARGER((R(0.5) * (a + d)) + wide, R(0.0))) < R(20.0);
        for (i = 0; i < 3; i++)
        {
            fresh[i] = (i < 2) ? placed : (out->deviation[2] < R(2.0));
            fresh[3 + i] = largest(s, ATTITUDE) < R(0.2);
            fresh[6 + i] = largest(s, VELOCITY) < R(0.3);
            fresh[9 + i] = largest(s, RATES) < R(0.1);
            fresh[13 + i] = fresh[6 + i];
        }
        fresh[12] = 0;
    }
    for (i = 0; (s->begun == 0) && (i < 16); i++)
    {
        channels[i] = is_number(s->first[i]) ? s->first[i] : R(0.0);
        fresh[i] = 0;
    }
@TOLD@    return s->begun;
}

//if autopilot
int FILTER_tell(const FILTER_parameters *p, const FILTER_state *s, AUTOPILOT_input *in)
{
    FILTER_output out;
    const int begun = FILTER_estimate(p, s, &out);
@FILLED@    return begun;
}

//end
