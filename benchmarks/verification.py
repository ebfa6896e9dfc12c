"""The whole verification card of every installed solver.

    python benchmarks/verification.py [SOLVER ...] [--cases FIRST-LAST]

The reference, in NumPy, takes hours. `--cases 21-30` runs these ten, counted from 1 in the card's order.
"""

import argparse
import re
import sys
import time

from machine import print_machine

from slideframe.commands.verify import chosen_solvers
from slideframe.device import Device
from slideframe.verification.card import HEADER, row, summary
from slideframe.verification.case import Case
from slideframe.verification.rig import Rig
from slideframe.verification.suite import CASES


def some_cases(text: str) -> list[Case]:
    """Return the cases from FIRST to LAST."""
    match = re.fullmatch(r"(\d+)-(\d+)", text)
    if not match or not 1 <= int(match[1]) <= int(match[2]) <= len(CASES):
        raise argparse.ArgumentTypeError(f"write FIRST-LAST, from 1 to {len(CASES)}")
    return list(CASES[int(match[1]) - 1 : int(match[2])])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("solvers", nargs="*")
    parser.add_argument("--cases", type=some_cases, default=list(CASES), metavar="FIRST-LAST")
    options = parser.parse_args()
    print_machine("slideframe", "numpy", "warp-lang", "taichi")
    print("$ python benchmarks/verification.py", *sys.argv[1:])
    failed = 0
    for solver in [one for name in options.solvers or [None] for one in chosen_solvers(name)]:
        started, processor = time.perf_counter(), time.process_time()
        rig, lines = Rig(solver, Device()), []
        print(f"{solver.name} on {rig.device}\n{HEADER}")
        for case in options.cases:
            for line in case.lines(rig):
                lines.append(line)
                print(row(line), flush=True)
        failed += sum(not line.passed for line in lines)
        seconds, busy = time.perf_counter() - started, time.process_time() - processor
        print(f"{summary(solver.name, lines)}\n{seconds:.0f} s, {busy:.0f} s of processors\n", flush=True)
    return 4 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
