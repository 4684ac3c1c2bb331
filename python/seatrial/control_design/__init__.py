"""Control design: trim, loop models, margins, start gains, linear-quadratic regulator."""
