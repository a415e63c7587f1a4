from foreswitch._binding._core_float64 import *  # noqa: F403
