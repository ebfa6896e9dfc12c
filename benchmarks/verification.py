"""The whole verification card of every installed solver.

    python benchmarks/verification.py [SOLVER ...]

The reference, in NumPy, takes some fifty times as long as the others (see mpm.py): name solvers to leave it out.
"""

import sys
import time

from machine import print_machine

from slideframe.commands.verify import main as verify


def main() -> int:
    print_machine("slideframe", "numpy", "warp-lang", "taichi")
    print("$ python benchmarks/verification.py", *sys.argv[1:])
    started = time.perf_counter()
    solvers = [["--solver", name] for name in sys.argv[1:]] or [[]]
    worst = max(verify(choice) for choice in solvers)
    print(f"{time.perf_counter() - started:.0f} s")
    return worst


if __name__ == "__main__":
    sys.exit(main())
