"""How long the quick commands take from a cold interpreter, beside an interpreter that does nothing.

    python benchmarks/start_up.py [REPEATS]

Prints the best and the median wall milliseconds of each, and the ratio of the medians to the bare interpreter's.
"""

import statistics
import subprocess
import sys
import time

from machine import print_machine

CASES = {
    "bare interpreter": ["-c", "pass"],
    "import numpy": ["-c", "import numpy"],
    "slideframe --help": ["-m", "slideframe.cli", "--help"],
    "slideframe plugins": ["-m", "slideframe.cli", "plugins"],
    "slideframe run --help": ["-m", "slideframe.cli", "run", "--help"],
    "slideframe schema": ["-m", "slideframe.cli", "schema"],
}


def measure(arguments: list[str]) -> float:
    start = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    return 1e3 * (time.perf_counter() - start)


def main() -> None:
    print_machine("slideframe")
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    times: dict[str, list[float]] = {name: [] for name in CASES}
    for _ in range(repeats):  # interleaved, so that a busy moment harms all alike
        for name, arguments in CASES.items():
            times[name].append(measure(arguments))
    bare = statistics.median(times["bare interpreter"])
    print(f"{'case':<24}{'best ms':>10}{'median ms':>11}{'ratio':>8}")
    for name, values in times.items():
        median = statistics.median(values)
        print(f"{name:<24}{min(values):>10.0f}{median:>11.0f}{median / bare:>8.1f}")


if __name__ == "__main__":
    main()
