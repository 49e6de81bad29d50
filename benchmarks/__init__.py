"""Computing times: control steps, beside other solvers, over horizons and over DDS."""
