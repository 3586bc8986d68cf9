"""A sampler of structures beside variational Bayes on S4, in one run: ``python tests/benchmarks/bench_gibbs.py``.

The sampler is that of `deatwin.ident.narx.spike_slab`, which unit tests hold against enumeration. Both get the
same draws of S4, of 500 samples and 165 candidates. Three things are shown for each draw: whether the terms that the
sampler holds for more likely in than out are those of SVB; which probability the sampler gives to SVB's 95 % intervals,
with SVB's structure and over all structures; and how far two chains, one started without terms and one with 20 at
random, differ in the probability of a term. Times are processor times with one thread. No test depends on them.
"""

from __future__ import annotations

import argparse

import numpy as np
from threadpoolctl import threadpool_limits

from deatwin.scenarios.svb_benchmark.draws import BURN_IN, FLIPS, Comparison, compare
from deatwin.scenarios.svb_benchmark.methods import METHODS


def line(found: Comparison) -> str:
    return (
        f"{found.number:4d}  {'yes' if found.agrees else 'no':>10}  {np.sort(found.inclusion)[-5]:12.4f}  "
        f"{found.unsettled:10.1e}  {100 * found.mass_given.mean():9.1f} %  {100 * found.mass.mean():9.1f} %  "
        f"{found.seconds:8.3f}  {found.sampled_seconds:8.3f}  {found.sampled_seconds / found.seconds:6.1f}"
    )


def main() -> None:
    bayesian = [name for name in METHODS if name.startswith("svb")]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--method", choices=bayesian, default=bayesian[-1])
    given = parser.parse_args()
    print(f"S4, {METHODS[given.method].label}; a chain of {FLIPS} flips after {BURN_IN}")
    print("draw  same terms  fifth likely  chains by  mass, same  mass, all    SVB (s)  chain (s)  ratio")
    with threadpool_limits(1):
        compare("S4", given.method, given.seed, given.draws)  # warm
        found = [compare("S4", given.method, given.seed, number) for number in range(given.draws)]
    print("\n".join(map(line, found)))
    ratio = np.median([f.sampled_seconds / f.seconds for f in found])
    same = sum(f.agrees for f in found)
    print(f"same terms in {same} of {len(found)}; time of a chain over SVB's, median {ratio:.1f}")


if __name__ == "__main__":
    main()
