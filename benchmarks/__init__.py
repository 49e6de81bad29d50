"""How long things take: control steps, beside other solvers, over horizons and over DDS."""
