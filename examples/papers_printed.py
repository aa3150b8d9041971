"""What three papers print
=======================

What three papers print, beside what follows from their own numbers: one table.

For each printed figure: paper, figure, printed value, ours, the outcome and why. Ours is worked out
on the spot from the paper's other numbers, by closed forms and by simulation; what was measured,
and whose record is not printed, cannot be checked, nor can what takes a choice of our own (figure
11 and section 5.2 of Siramdasu & Fahimi). A figure is reproduced where every way that leads to it
comes within 5 %; how many are, and which are not or by some ways only, is said below the table.
Among these are

- Yoerger et al. 1990: the two tests of one thruster differ (ct by 14 %, beta/alpha by 13 %); an
  efficiency of 0.22 goes with neither ct; the time constant of 0.75 s at 1 V goes neither with the
  model nor with the paper's own 0.49 sqrt(u), and the lead network is that of 0.712 s; break
  frequencies "below 2" end at 90 N; the limit cycle's 15.7 N is not what the printed formula gives
  (19.3 N), but what the describing function of the simulated thruster does;
- Siramdasu & Fahimi 2013: lambda = 1.56 s is not I33 / d33; 0.75 m/s is below the speed of every
  straight run; signs of equations (3), (8), (14) and (16);
- Aras et al. 2013: the offset of equation 9, a depth of 70 m, the encoder's speed, and a
  proportional loop that is said to reach its set point.

The rows of each paper are made in ``printed/``.

    python examples/papers_printed.py
"""

from printed.all import printed_figures
from printed.printed import counts, printed_table


def main() -> None:
    rows = printed_figures()
    print(printed_table(rows))

    for source in dict.fromkeys(row.source for row in rows):
        outcomes = counts(row for row in rows if row.source == source)
        told = ", ".join(f"{len(figures)} {outcome}" for outcome, figures in outcomes.items())
        print(f"{source}: {sum(map(len, outcomes.values()))} figures, {told}:")
        for outcome in ("not reproduced", "reproduced by some ways only"):
            for what in outcomes[outcome]:
                ways = [r for r in rows if r.source == source and r.what == what]
                ratios = " or ".join(f"{row.ratio:.3g}" for row in ways)
                print(f"  {what}, {outcome}: ours is {ratios} of the printed value")


if __name__ == "__main__":
    main()
