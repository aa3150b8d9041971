"""What three papers print, beside what follows from their own numbers: one table.

For each printed figure that can be checked: paper, figure, printed value, ours, ratio and remark.
Ours is worked out on the spot by the papers' methods on simulated records, by closed forms and by
simulation. A ratio near 1 says that the figure follows from the paper's other numbers; the figures
that depart by more than 5 % are listed once more below the table, among them

- Yoerger et al. 1990: the two tests of one thruster differ (ct by 14 %, beta/alpha by 13 %); an
  efficiency of 0.22 goes with neither ct; the time constant of 0.75 s at 1 V goes neither with the
  model nor with the paper's own 0.49 sqrt(u); break frequencies "below 2" end at 90 N; the limit
  cycle's 15.7 N is not what the printed formula gives;
- Siramdasu & Fahimi 2013: lambda = 1.56 s is not I33 / d33; 0.75 m/s is below the speed of every
  straight run; signs of equations (3), (8), (14) and (16);
- Aras et al. 2013: the offset of equation 9, a depth of 70 m, the encoder's speed, and a
  proportional loop that is said to reach its set point.

The rows of each paper are made in ``printed/``.

    python examples/papers_printed.py
"""

from printed.all import printed_figures
from printed.printed import printed_table


def main() -> None:
    rows = printed_figures()
    print(printed_table(rows))

    for source in dict.fromkeys(row.source for row in rows):
        mine = [row for row in rows if row.source == source]
        away: dict[str, list[str]] = {}
        for row in mine:
            if not abs(row.ratio - 1.0) <= 0.05:
                away.setdefault(row.what, []).append(f"{row.ratio:.3g}")
        print(f"{source}: {len(mine)} rows, {sum(map(len, away.values()))} of them depart by more "
              "than 5 %:")  # fmt: skip
        for what, ratios in away.items():
            print(f"  {what}: ours is {' or '.join(ratios)} of the printed value")


if __name__ == "__main__":
    main()
