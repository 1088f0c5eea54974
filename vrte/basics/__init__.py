"""What every other folder uses: arrays, errors, threads, memory, quadrature."""
