"""Outside checks: Pinocchio for the kinematics, CasADi for the identification."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submodules=["casadi_baseline", "comparison", "pinocchio_model"]
)
