"""Independent reference simulator: the plants that tests and shipped logs are made from.

Written with NumPy and SciPy alone, from the papers, without a line of the package under test, so
that a mistake in one is not repeated in the other. Plants are solved by DOP853 between the kinks
of their inputs and of their own (see :mod:`.integrate`); a quick fixed-step method serves long
studies. Each plant takes hidden effects by name, with physical sizes.

    from reference import inputs, noise, thruster

    rng = np.random.default_rng(1)
    time = inputs.grid(60.0, 0.05)
    record = thruster.simulate(time, inputs.staircase(time, [1.0, -2.0], 5.0), coulomb_friction=8.0)
    record = noise.measure(record, rng, speed=noise.Sensor(0.2), thrust=noise.Sensor(0.5))
"""
