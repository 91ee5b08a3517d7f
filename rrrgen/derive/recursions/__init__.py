"""The recursions over the chain, written once for any scalar: motion, forces, composite bodies, regressors."""
