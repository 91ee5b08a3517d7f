"""The recursions over the chain, written once for any scalar: motion, wrenches, composite bodies, regressors."""
