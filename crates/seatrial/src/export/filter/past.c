/* Samples that come late are compared with the mean of their own time, and told of as errors of now. The way
   back over a period, out of the derivatives over it: Gauss and Jordan in place, the columns of the force carried along. */
static void reverse(real block[MOTION][COLUMNS], const real kept[6], real back[MOTION][COLUMNS])
{
    real work[9][COLUMNS];
    int leading[9];
    int i;
    int j;
    int k;
    for (i = 0; i < 9; i++)
    {
        for (j = 0; j < COLUMNS; j++)
        {
            work[i][j] = block[3 + i][j];
        }
    }
    for (k = 0; k < 9; k++)
    {
        real scale;
        leading[k] = k;
        if (ABS(work[k][k]) < R(0.1))
        {
            for (i = k + 1; i < 9; i++)
            {
                if (ABS(work[i][k]) > ABS(work[leading[k]][k]))
                {
                    leading[k] = i;
                }
            }
            for (j = 0; j < COLUMNS; j++)
            {
                const real swapped = work[k][j];
                work[k][j] = work[leading[k]][j];
                work[leading[k]][j] = swapped;
            }
        }
        scale = R(1.0) / work[k][k];
        for (j = 0; j < COLUMNS; j++)
        {
            work[k][j] = (j == k) ? scale : (work[k][j] * scale);
        }
        for (i = 0; i < 9; i++)
        {
            const real share = work[i][k];
            for (j = 0; (i != k) && (j < COLUMNS); j++)
            {
                work[i][j] = (j == k) ? -(scale * share) : (work[i][j] - (work[k][j] * share));
            }
        }
    }
    for (k = 8; k >= 0; k--)
    {
        for (i = 0; (leading[k] != k) && (i < 9); i++)
        {
            const real swapped = work[i][k];
            work[i][k] = work[i][leading[k]];
            work[i][leading[k]] = swapped;
        }
    }
    for (j = 0; j < COLUMNS; j++)
    {
        for (i = 0; i < 3; i++)
        {
            real sum = R(0.0);
            for (k = 0; k < 9; k++)
            {
                sum -= work[k][j] * block[i][k];
            }
            back[i][j] = (j < 9) ? sum : (-(sum + block[i][j]) / kept[j - 9]);
        }
        for (i = 0; i < 9; i++)
        {
            back[3 + i][j] = (j < 9) ? work[i][j] : (-work[i][j] / kept[j - 9]);
        }
    }
}

/* What a row of before a period is after it. */
static void carry(const FILTER_constants *k, const real back[MOTION][COLUMNS], const real swept[3][3], struct row *row)
{
    real sum[COLUMNS];
    real *h = row->h;
    int i;
    int j;
    for (j = 0; j < COLUMNS; j++)
    {
        sum[j] = R(0.0);
    }
    for (i = 0; i < MOTION; i++)
    {
        const int end = (((row->parts >> (i / 3)) & 1u) != 0u) ? COLUMNS : 0;
        for (j = 0; j < end; j++)
        {
            sum[j] += h[i] * back[i][j];
        }
    }
    for (i = 0; i < 6; i++)
    {
        sum[9 + i] += h[FORCE + i] / k->kept[i];
    }
    for (j = 0; j < COLUMNS; j++)
    {
        h[ATTITUDE + j] = sum[j];
    }
    for (i = 0; i < 3; i++)
    {
        h[CURRENT + i] = (h[CURRENT + i] - (PERIOD * h[POSITION + i])) / k->slow[i];
    }
    for (i = 0; i < 3; i++)
    {
        for (j = 0; j < 3; j++)
        {
            h[FORCE + j] -= h[CURRENT + i] * swept[i][j];
        }
    }
    row->parts |= 0x3eu | ((row->parts & 1u) << 6);
}

/* The moment so many periods before the newest. */
static const FILTER_moment *moment(const FILTER_state *s, int ago)
{
    return &s->past[((s->newest + KEPT) - ago) % KEPT];
}

/* Keeps the end of a period. */
static void keep(FILTER_state *s, const real moved[STATES])
{
    FILTER_moment *end;
    int i;
    int j;
    s->newest = (s->newest + 1) % KEPT;
    s->count += (s->count < KEPT) ? 1 : 0;
    end = &s->past[s->newest];
    end->time = s->time;
    end->mean = s->mean;
    for (i = 0; i < STATES; i++)
    {
        end->moved[i] = moved[i];
    }
    for (i = 0; i < MOTION; i++)
    {
        for (j = 0; j < COLUMNS; j++)
        {
            end->back[i][j] = s->back[i][j];
        }
    }
    for (i = 0; i < 3; i++)
    {
        for (j = 0; j < 3; j++)
        {
            end->swept[i][j] = s->swept[i][j];
        }
    }
}

/* The error that leads from one mean to another. */
static void apart(const FILTER_mean *from, const FILTER_mean *to, real error[STATES])
{
    const real back[4] = { from->attitude[0], -from->attitude[1], -from->attitude[2], -from->attitude[3] };
    real q[4];
    real sine;
    real scale;
    int i;
    quaternion_product(back, to->attitude, q);
    for (i = 3; i >= 0; i--)
    {
        q[i] = (q[0] < R(0.0)) ? -q[i] : q[i];
    }
    sine = SQRT(dot(&q[1], &q[1]));
    scale = (sine < R(1e-9)) ? R(2.0) : ((R(2.0) * ATAN2(sine, q[0])) / sine);
    for (i = 0; i < 3; i++)
    {
        error[POSITION + i] = to->position[i] - from->position[i];
        error[ATTITUDE + i] = q[1 + i] * scale;
        error[CURRENT + i] = to->current[i] - from->current[i];
        error[GYRO + i] = to->gyro_bias[i] - from->gyro_bias[i];
    }
    for (i = 0; i < 6; i++)
    {
        error[VELOCITY + i] = to->nu[i] - from->nu[i];
        error[FORCE + i] = to->force[i] - from->force[i];
    }
}

/* The mean of an earlier time: the periods since the moment before it, and where between it and the next the time lies; 0
   where that is not kept. */
static int between(const FILTER_state *s, real time, FILTER_mean *then, int *back, real *share)
{
    real error[STATES];
    const FILTER_moment *before = 0;
    const FILTER_mean *after = &s->mean;
    real next = s->time;
    int ago;
    int i;
    for (ago = 0; (ago < s->count) && (before == 0); ago++)
    {
        const FILTER_moment *candidate = moment(s, ago);
        if (candidate->time <= (time + (SLACK * PERIOD)))
        {
            before = candidate;
            *back = ago;
        }
        else
        {
            next = candidate->time;
            after = &candidate->mean;
        }
    }
    if (before == 0)
    {
        return 0;
    }
    *share = (time - before->time) / (next - before->time);
    *then = before->mean;
    apart(&before->mean, after, error);
    for (i = 0; i < STATES; i++)
    {
        error[i] *= *share;
    }
    (void)inject(then, error);
    return 1;
}

/* Tells a row of an earlier time as one of now; returns what samples have corrected of it since. */
static real brought_here(const FILTER_constants *k, const FILTER_state *s, int back, real share, struct row *row)
{
    const int nearest = (share < R(0.5)) ? (back + 1) : back;
    real corrected = R(0.0);
    int later;
    if (nearest == 0)
    {
        return R(0.0);
    }
    if (nearest == back)
    {
        corrected += (R(1.0) - share) * times(row, moment(s, back - 1)->moved);
    }
    for (later = nearest - 1; later >= 1; later--)
    {
        const FILTER_moment *to = moment(s, later - 1);
        carry(k, to->back, to->swept, row);
        corrected += ((later == back) ? (R(1.0) - share) : R(1.0)) * times(row, to->moved);
    }
    carry(k, (const real(*)[COLUMNS])s->back, (const real(*)[3])s->swept, row);
    return corrected;
}
