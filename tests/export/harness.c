/* Vehicle and autopilot in closed loop with perfect sensors: prints the motion of every period, in single precision too.
   loop.h names the programs and says what of one is told to the other. With WITH_FILTER the autopilot goes by the
   navigation filter, which the sensors tell. */
#include <math.h>
#include <stdio.h>

#include "loop.h"
#ifdef WITH_FILTER
#include "navigate.h"
#endif

#ifndef PERIODS
#define PERIODS 1000
#endif

int main(void)
{
    static VEHICLE(parameters) vp;
    static VEHICLE(constants) vk;
    static VEHICLE(state) vs;
    static VEHICLE(input) vin;
    static VEHICLE(output) vout;
    static AUTOPILOT(parameters) ap;
    static AUTOPILOT(constants) ak;
    static AUTOPILOT(state) as;
    static AUTOPILOT(input) ain;
    static AUTOPILOT(output) aout;
    int k;
    int i;
    VEHICLE(defaults)(&vp);
    VEHICLE(prepare)(&vp, &vk);
    VEHICLE(begin)(&vs, &vin);
    AUTOPILOT(defaults)(&ap);
    AUTOPILOT(prepare)(&ap, &ak);
    AUTOPILOT(begin)(&as, &ain);
    launch(&vin, &ain);
    for (k = 0; k < PERIODS; k++)
    {
        VEHICLE(measure)(&vp, &vk, &vs, &vin, &vout);
        tell(k, &vout, &ain);
#ifdef WITH_FILTER
        navigate(k, &vout, &aout, &ain);
#endif
        AUTOPILOT(step)(&ap, &ak, &as, &ain, &aout);
        obey(&aout, &vin);
        printf("%.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n", (double)vout.x, (double)vout.y,
            (double)vout.z, (double)vout.roll, (double)vout.pitch, (double)vout.yaw, (double)vout.u,
            (double)aout.alert, (double)aout.demanded_X);
        for (i = 0; i < SUBSTEPS; i++)
        {
            VEHICLE(step)(&vp, &vk, &vs, &vin);
        }
    }
    return 0;
}
