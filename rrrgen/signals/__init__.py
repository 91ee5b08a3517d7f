"""Sampled signals: reconstruction of motion, Kalman filter and smoother, Fourier series, decimation."""
