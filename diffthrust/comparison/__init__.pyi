from ._compare import Comparison as Comparison
from ._compare import Errors as Errors
from ._compare import compare as compare
from ._residual_tests import NoiseAdvice as NoiseAdvice
