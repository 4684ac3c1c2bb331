/* Vehicle and autopilot in closed loop with perfect sensors: prints the motion of every period, in single precision too.
   With WITH_FILTER the autopilot goes by the navigation filter, which the sensors tell. */
#include <math.h>
#include <stdio.h>

#include "cwolf_autopilot.h"
#include "cwolf_vehicle.h"
#ifdef WITH_FILTER
#include "cwolf_filter.h"
#endif

#ifndef PERIODS
#define PERIODS 1000
#endif
#define SUBSTEPS 5

#ifdef WITH_FILTER
static cwolf_filter_parameters fp;
static cwolf_filter_constants fk;
static cwolf_filter_state fs;
static cwolf_filter_input fin;

static void navigate(int k, const cwolf_vehicle_output *shown, const cwolf_autopilot_output *asked, cwolf_autopilot_input *told)
{
    const cwolf_filter_real place[2] = { shown->x, shown->y };
    const cwolf_filter_real attitude[3] = { shown->roll, shown->pitch, shown->yaw };
    const cwolf_filter_real ground[3] = { shown->u, shown->v, shown->w };
    const cwolf_filter_real rates[3] = { shown->p, shown->q, shown->r };
    const cwolf_filter_real water[3] = { shown->u_water, shown->v_water, shown->w_water };
    if (k == 0)
    {
        cwolf_filter_defaults(&fp);
        cwolf_filter_prepare(&fp, &fk);
        cwolf_filter_begin(&fs, &fin);
    }
    else
    {
        fin.cmd_SbU = asked->cmd_SbU;
        fin.cmd_SbL = asked->cmd_SbL;
        fin.cmd_PU = asked->cmd_PU;
        fin.cmd_PL = asked->cmd_PL;
        fin.cmd_VTS = asked->cmd_VTS;
        fin.cmd_VTB = asked->cmd_VTB;
        fin.act_SbU = shown->act_SbU;
        fin.act_SbL = shown->act_SbL;
        fin.act_PU = shown->act_PU;
        fin.act_PL = shown->act_PL;
        fin.act_VTS = shown->act_VTS;
        fin.act_VTB = shown->act_VTB;
        cwolf_filter_predict(&fp, &fk, &fs, &fin);
    }
    cwolf_filter_position(&fp, &fk, &fs, place, 0);
    cwolf_filter_depth(&fp, &fk, &fs, shown->z, 0);
    cwolf_filter_attitude(&fp, &fk, &fs, attitude, 0);
    cwolf_filter_dvl(&fp, &fk, &fs, ground, 0);
    cwolf_filter_gyro(&fp, &fk, &fs, rates, 0);
    cwolf_filter_dvl_water(&fp, &fk, &fs, water, 0);
    (void)cwolf_filter_settle(&fp, &fk, &fs);
    (void)cwolf_filter_tell(&fp, &fs, told);
}
#endif

int main(void)
{
    static cwolf_vehicle_parameters vp;
    static cwolf_vehicle_constants vk;
    static cwolf_vehicle_state vs;
    static cwolf_vehicle_input vin;
    static cwolf_vehicle_output vout;
    static cwolf_autopilot_parameters ap;
    static cwolf_autopilot_constants ak;
    static cwolf_autopilot_state as;
    static cwolf_autopilot_input ain;
    static cwolf_autopilot_output aout;
    int k;
    int i;
    cwolf_vehicle_defaults(&vp);
    cwolf_vehicle_prepare(&vp, &vk);
    cwolf_vehicle_begin(&vs, &vin);
    cwolf_autopilot_defaults(&ap);
    cwolf_autopilot_prepare(&ap, &ak);
    cwolf_autopilot_begin(&as, &ain);
    vin.current_north = (cwolf_vehicle_real)0.1;
    vin.current_east = (cwolf_vehicle_real)-0.15;
    ain.age_altitude = 0;
    ain.age_u_water = 0;
    ain.age_v_water = 0;
    ain.age_w_water = 0;
    for (k = 0; k < PERIODS; k++)
    {
        cwolf_vehicle_measure(&vp, &vk, &vs, &vin, &vout);
        ain.x = vout.x;
        ain.y = vout.y;
        ain.z = vout.z;
        ain.roll = vout.roll;
        ain.pitch = vout.pitch;
        ain.yaw = vout.yaw;
        ain.u = vout.u;
        ain.v = vout.v;
        ain.w = vout.w;
        ain.p = vout.p;
        ain.q = vout.q;
        ain.r = vout.r;
        ain.altitude = vout.altitude;
        ain.u_water = vout.u_water;
        ain.v_water = vout.v_water;
        ain.w_water = vout.w_water;
        ain.act_SbU = vout.act_SbU;
        ain.act_SbL = vout.act_SbL;
        ain.act_PU = vout.act_PU;
        ain.act_PL = vout.act_PL;
        ain.act_VTS = vout.act_VTS;
        ain.act_VTB = vout.act_VTB;
#ifdef WITH_FILTER
        navigate(k, &vout, &aout, &ain);
#endif
        cwolf_autopilot_step(&ap, &ak, &as, &ain, &aout);
        vin.cmd_SbU = aout.cmd_SbU;
        vin.cmd_SbL = aout.cmd_SbL;
        vin.cmd_PU = aout.cmd_PU;
        vin.cmd_PL = aout.cmd_PL;
        vin.cmd_VTS = aout.cmd_VTS;
        vin.cmd_VTB = aout.cmd_VTB;
        printf("%.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n", (double)vout.x, (double)vout.y, (double)vout.z,
            (double)vout.roll, (double)vout.pitch, (double)vout.yaw, (double)vout.u, (double)aout.cmd_SbU);
        for (i = 0; i < SUBSTEPS; i++)
        {
            cwolf_vehicle_step(&vp, &vk, &vs, &vin);
        }
    }
    return 0;
}
