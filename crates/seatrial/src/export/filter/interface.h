/* A sensor; what it measures has the unit that stands beside it among the parameters. */
typedef struct
{
    FILTER_real noise; /* standard deviation of a sample */
    FILTER_real bias; /* standard deviation of its constant offset */
    FILTER_real latency; /* s: age of a sample when it arrives; what is older than the export foresaw is not taken */
    FILTER_real arm[3]; /* m: its place from O, body frame */
    FILTER_real mount[3]; /* rad: roll, pitch and yaw of its mounting */
} FILTER_instrument;

/* What may be set before prepare(). */
typedef struct
{
@PARAMETERS@} FILTER_parameters;

/* What follows from the parameters; made by prepare(). */
typedef struct
{
    FILTER_real kept[6]; /* 1: of the force after a period */
    FILTER_real slow[3]; /* 1: of the current after a period */
    FILTER_real noise[24]; /* variance that a period adds, in the order of the covariance; the rest follows the motion */
    FILTER_real mount[FILTER_MOUNTS][3][3]; /* 1: rotation from a sensor to the body */
    FILTER_real facing[4]; /* 1: the same of the attitude sensor, as a quaternion */
} FILTER_constants;

/* The mean of the state. */
typedef struct
{
    FILTER_real position[3]; /* m: north, east, down */
    FILTER_real attitude[4]; /* 1: quaternion, body to north-east-down */
    FILTER_real nu[6]; /* m/s, rad/s: velocity through the water and turn rates, body frame */
    FILTER_real force[6]; /* N, N m: what the model does not know, body frame */
    FILTER_real current[3]; /* m/s: velocity of the water, north, east, down */
    FILTER_real gyro_bias[3]; /* rad/s: what the gyro shows at rest */
} FILTER_mean;

/* The record of one channel. */
typedef struct
{
    FILTER_real sum; /* 1: normalised innovations squared of the samples that were taken */
    FILTER_real recent; /* 1: recent mean of them, of all samples */
    FILTER_real since; /* s: when the first of the refusals without a break came, and the silence since */
    FILTER_real last; /* s: when the last sample came */
    FILTER_real gap; /* s: between it and the one before */
    unsigned long taken; /* samples */
    unsigned long refused; /* samples */
    unsigned long recovered; /* times that the filter had to forget */
    unsigned in_a_row; /* refusals without a break */
} FILTER_watch;

//if past
/* The end of a period, for samples that come late. */
typedef struct
{
    FILTER_real time; /* s */
    FILTER_mean mean;
    FILTER_real back[12][15]; /* derivatives of the motion before the period by that after it */
    FILTER_real swept[3][3]; /* derivatives of the current by the force */
    FILTER_real moved[24]; /* what its samples corrected */
} FILTER_moment;

//end
/* What is remembered from period to period; made by begin(). */
typedef struct
{
    FILTER_mean mean;
    FILTER_real covariance[24][24]; /* SI: position, attitude, velocity, rates, force, moment, current, gyro */
    FILTER_real error[24]; /* what this period's samples have found, not yet part of the mean */
    FILTER_real time; /* s */
    FILTER_real age; /* s: since it began */
    FILTER_real patience; /* s: so long it does not take itself for lost */
    FILTER_real doubted; /* s: for which two instruments have contradicted it */
    FILTER_real place[3]; /* m: where it begins anew unless a fix says it */
    FILTER_real far[3]; /* m: standard deviation of that; NAN at the launch */
    FILTER_real first[FILTER_CHANNELS]; /* the last sample of each channel */
    FILTER_real silent[FILTER_CHANNELS]; /* s: time since then */
    FILTER_watch watch[FILTER_CHANNELS];
//if surface
    FILTER_real beam[FILTER_MARKS]; /* rad: where the sonar looks for each surface */
//end
//if past
    FILTER_moment past[FILTER_KEPT]; /* a ring */
    FILTER_real back[12][15]; /* of the period that has not ended yet */
    FILTER_real swept[3][3]; /* of the current by the force, in that period */
    int newest; /* place in the ring */
    int count; /* moments in it */
//end
    int begun; /* 1 once the attitude has been measured */
    int open; /* 1 between predict() and settle() */
    unsigned long restarts; /* times that the filter had to begin anew */
@MOTORS@} FILTER_state;

/* What the actuators are told, and what they are measured at. */
typedef struct
{
@INPUTS@} FILTER_input;

/* The estimate. */
typedef struct
{
@OUTPUTS@    FILTER_real deviation[24]; /* SI: standard deviations in the order of the covariance, offsets included */
} FILTER_output;

/* The parameters as they were exported. */
void FILTER_defaults(FILTER_parameters *p);

/* The constants that follow from the parameters; again after each change of them. */
void FILTER_prepare(const FILTER_parameters *p, FILTER_constants *k);

/* The filter before its first sample, and commands at rest. */
void FILTER_begin(FILTER_state *s, FILTER_input *in);

/* One period under the commands that have held during it; what the actuators are measured at is true at its end. */
void FILTER_predict(const FILTER_parameters *p, const FILTER_constants *k, FILTER_state *s,
    const FILTER_input *in);

@SENSORS@/* After the samples of a period: what they have found becomes part of the mean. Returns whether there is an estimate. */
int FILTER_settle(const FILTER_parameters *p, const FILTER_constants *k, FILTER_state *s);

/* The estimate of a settled filter; before it has begun the last samples. Returns whether there is an estimate. */
int FILTER_estimate(const FILTER_parameters *p, const FILTER_state *s, FILTER_output *out);

//if autopilot
/* The same in the place of what sensors show an autopilot. */
int FILTER_tell(const FILTER_parameters *p, const FILTER_state *s, AUTOPILOT_input *in);

//end
