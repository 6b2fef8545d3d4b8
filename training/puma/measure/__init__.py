"""How fast a configuration is, whether it can learn, and how far a trained policy errs, without a
simulator."""
