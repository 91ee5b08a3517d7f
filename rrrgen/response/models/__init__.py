"""Linear models fitted to responses and recordings, with their resonances."""
