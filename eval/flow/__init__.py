"""Dense flow methods, compared where the true flow is known: ``python -m eval flow``."""
