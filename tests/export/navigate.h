/* The navigation filter, which the perfect sensors of the harness tell, and which tells the autopilot. */
#include "cwolf_filter.h"

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
