"""Joint motions as functions of time: Fourier series, polynomials, files."""
