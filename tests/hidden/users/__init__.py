"""Logs as new users write them, of plants with something hidden, and what may be said of them.

Each plant is written out here in NumPy, without the package and without `reference`'s simulators,
and its logs go through a CSV file, in the units of its sensors. Beside the model as its user would
write it, a set carries the truth, and two systems of `reference.whole_runs`: the same equations as
given and with what is hidden, to be fitted by a plain least squares.

    from hidden import users
    made = users.draw("boat", 3)
    diag = dft.diagnose(made.model, made.train, holdout=made.unseen)
    users.judge(diag, made)

One row a seed, from the folder ``tests``:

    python -m hidden.users boat --count 10 --out rows.jsonl

| kind | what is hidden |
| --- | --- |
| boat | a steady current, one thruster a fifth weaker, two quadratic drags; positions measured |
| boat_speeds | the same boat, its speed over ground measured instead |
| bench | dead band, sag, latency, reverse thrust, tare (every third seed: a saturation) |
| battery | thrust lost below 14 V in proportion to speed |
| gear_motor | an imbalance: a torque with the angle of the shaft |
| tanks | an overflow, and flows in proportion to the levels; the upper level is unmeasured |
| held_readings | nothing, or (odd seeds) a saturation; 97 % of the readings are repeats |
| periodic_force | a torque at a frequency in time, its phase by log |
| dominating_channel | quadratic surge drag, beside a sway whose reading drifts |
| astern_runs | less thrust astern, seen in one training log of six |
"""

from .draw import KINDS as KINDS
from .draw import draw as draw
from .judge import Judgement as Judgement
from .judge import judge as judge
from .made import Hidden as Hidden
from .made import UserSet as UserSet
