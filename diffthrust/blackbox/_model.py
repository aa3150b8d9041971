"""The result of black-box identification: a sampled linear model, its words and its figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from diffthrust._support.figures import showing
from diffthrust._support.report import Report
from diffthrust._support.results import Result
from diffthrust.blackbox._sampled_model import SampledModel
from diffthrust.logs._log import Log

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class BlackBox(Result, SampledModel):
    """A sampled linear model of a log's inputs and outputs, with its parameters and errors.

    Example:
        >>> model = dft.blackbox.arx(log, input="command", output="thrust", orders=(1, 1, 1))
        >>> model.kind, model.status, sorted(model.parameters)
        ('arx', <Status.CONVERGED: 'converged'>, ['a1', 'b1'])
        >>> figure = model.plot(unseen)
    """

    def to_control(self, form: Literal["transfer", "states"] = "transfer") -> Any:
        """The sampled model as an object of python-control, with the delay of the inputs in it.

        Args:
            form: "transfer" for a ``TransferFunction`` of one input and one output, "states" for a
                ``StateSpace`` of all.

        Raises:
            InputError: python-control is not installed, or several channels for "transfer".

        Example:
            >>> model = dft.blackbox.arx(log, input="command", output="thrust", orders=(1, 1, 1))
            >>> model.to_control().dt
            0.05
        """
        from diffthrust.blackbox._to_control import control_object

        return control_object(self, form)

    def _line(self) -> str:
        return f"{self}: {self.status}, {self.samples} samples"

    def _report(self) -> Report:
        from diffthrust.blackbox._tables import model_report

        return model_report(self)

    @showing
    def plot(self, log: Log) -> Figure:
        """Measured, simulated and predicted outputs of a log, and the residuals."""
        from diffthrust.blackbox._figures import model_figure

        return model_figure(self, log)
