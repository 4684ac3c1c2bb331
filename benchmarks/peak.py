"""The fused multiply-add peak of one core, measured: independent accumulators in full vector registers.

An FMA counts as two operations. The program takes the best of several rounds, because another process on the
machine only ever makes a round slower.
"""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

# Sixteen chains hide a latency of four cycles on two units, with room to spare.
PROGRAM = """
#include <stdio.h>
#include <time.h>
typedef double vector __attribute__((vector_size(BYTES)));
static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}
int main(void) {
    enum { CHAINS = 16, ROUNDS = 40, STEPS = 2000000 };
    double best = 0.0, check = 0.0;
    volatile double seed = 0.5;
    for (int round = 0; round < ROUNDS; round++) {
        vector x[CHAINS], factor, offset;
        for (unsigned i = 0; i < sizeof(vector) / 8; i++) { factor[i] = seed; offset[i] = seed; }
        for (int j = 0; j < CHAINS; j++) x[j] = offset * (double)j;
        double start = now();
        for (int step = 0; step < STEPS; step++)
            for (int j = 0; j < CHAINS; j++) x[j] = x[j] * factor + offset;
        double rate = 2.0 * CHAINS * STEPS * (sizeof(vector) / 8) / (now() - start);
        if (rate > best) best = rate;
        for (int j = 0; j < CHAINS; j++) check += x[j][0];
    }
    printf("%.6e %d\\n", check == -1.0 ? 0.0 : best, (int)sizeof(vector));
    return 0;
}
"""


def vector_bytes() -> int:
    """Return the width in bytes of the widest vector registers that the compiler finds on this machine."""
    command = ["gcc", "-march=native", "-dM", "-E", "-x", "c", "/dev/null"]
    macros = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return 64 if "__AVX512F__" in macros else 32 if "__AVX__" in macros else 16


def fma_peak() -> float:
    """Return the operations per second of one core in double precision (FMA = 2).

    Raises
    ------
    subprocess.CalledProcessError
        The compiler is absent or refuses the program.
    """
    with tempfile.TemporaryDirectory() as name:
        source, program = Path(name) / "peak.c", Path(name) / "peak"
        source.write_text(PROGRAM)
        # Unrolled, the chains stay in registers.
        options = ["-O3", "-march=native", "-funroll-loops", f"-DBYTES={vector_bytes()}"]
        subprocess.run(["gcc", *options, "-o", str(program), str(source)], check=True)
        printed = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout
    return float(printed.split()[0])
