from foreswitch._core_float64 import *  # noqa: F403
