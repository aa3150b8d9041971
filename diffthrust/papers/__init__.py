"""The papers' own methods, by the names of their first authors."""

from diffthrust.papers import aras as aras
from diffthrust.papers import siramdasu as siramdasu
from diffthrust.papers import yoerger as yoerger
from diffthrust.papers._commands import lowpass_noise as lowpass_noise
from diffthrust.papers._commands import staircase as staircase
from diffthrust.papers._line import Line as Line
from diffthrust.papers._line import fit_line as fit_line
from diffthrust.papers._manoeuvres import Manoeuvres as Manoeuvres
from diffthrust.papers._manoeuvres import manoeuvres as manoeuvres
from diffthrust.papers._printed import Printed as Printed
from diffthrust.papers._printed import printed_table as printed_table
from diffthrust.papers._printed_all import printed_figures as printed_figures
from diffthrust.papers._steady import Steady as Steady
from diffthrust.papers._steady import steady_portions as steady_portions
from diffthrust.papers._tabulated import TabulatedVessel as TabulatedVessel
from diffthrust.papers._undisturbed import undisturbed as undisturbed
