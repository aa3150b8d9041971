from ._export import TARGETS as TARGETS
from ._export import export_model as export_model
from ._exported import Exported as Exported
