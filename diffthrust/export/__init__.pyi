from ._export import TARGETS as TARGETS
from ._export import export_model as export_model
from ._source import Exported as Exported
