"""What a comparison works out from residuals, of any series: statistics, regimes, sentences."""

from diffthrust._support.correlation import (  # private: against closed forms
    autocorrelation,
    covariance,
    ljung_box,
)
from diffthrust.comparison._agreement import (  # private: of errors made by hand
    outstanding,
)
from diffthrust.comparison._derived_signals import (  # private: of made signals
    derived_signals,
)
from diffthrust.comparison._regimes import (  # private: on made residuals
    Regime,
    Samples,
    SignalRange,
    worst_range,
    worst_regimes,
)
from diffthrust.comparison._residual_tests import (  # private: the tests on made residuals alone
    cross_correlation,
    noise_advice,
    residual_tests,
)

__all__ = [
    "Regime",
    "Samples",
    "SignalRange",
    "autocorrelation",
    "covariance",
    "cross_correlation",
    "derived_signals",
    "ljung_box",
    "noise_advice",
    "outstanding",
    "residual_tests",
    "worst_range",
    "worst_regimes",
]
