# SPDX-License-Identifier: Apache-2.0
"""Replicas behind a ring of consistent hashing, under requests for trees by Zipf's law.

Three questions, each answered for trees of equal size and independent requests:
- how often a tree is in its replica's memory (least recently used goes first), by the formula of
  Che, Tung and Wang ("Hierarchical Web Caching Systems", 2002), which is checked here by simulating
  the replicas request by request;
- what the loss of a replica costs, by that simulation;
- how uneven the load is, with the hot trees on k replicas each.
The ring is HAProxy's: each server has 16 x weight points, and a tree belongs to the next one.
"""
import copy
import os
import sys

import numpy as np

import report_common as common
from report_common import plt

SEED = int(os.environ.get("KDRAY_SEED", "20261129"))
MESHES = 10**8
EXACT_RANKS = 1 << 17  # the ranks beyond are binned
POINTS = 1600  # of a server on the ring: 16 x the weight in replicas.cfg
CAPACITY = 10_000  # trees in a replica's memory
PLACES = 1000  # the same, where each request is simulated
EXPONENTS = (0.8, 1.0, 1.2)
REPLICAS = (1, 3, 10, 30, 100)
COLORS = ("#00798c", "#d1495b", "#edae49", "#30638e")


def zipf(count, exponent, exact=EXACT_RANKS):
    """(probability of an item, number of items) for each bin of ranks; the first are single."""
    exact = min(count, exact)
    ranks, numbers = np.arange(1, exact + 1, dtype=float), np.ones(exact)
    if count > exact:
        edges = np.unique(np.geomspace(exact + 1, count + 1, 4000).astype(np.int64))
        numbers = np.concatenate([numbers, np.diff(edges)])
        ranks = np.concatenate([ranks, np.sqrt(edges[:-1] * (edges[1:] - 1.0))])
    weights = ranks**-exponent
    return weights / (weights * numbers).sum(), numbers


def hit_rate(probabilities, numbers, places):
    """Of one memory that holds `places` items, the least recently used of which goes first."""
    if places >= numbers.sum():
        return 1.0
    low, high = 0.0, 100.0  # log10 of the number of requests for which an item stays
    for _ in range(100):
        middle = (low + high) / 2
        held = (numbers * -np.expm1(-probabilities * 10**middle)).sum()
        low, high = (middle, high) if held < places else (low, middle)
    return float((numbers * probabilities * -np.expm1(-probabilities * 10**low)).sum())


class Ring:
    """Points of servers on a circle of length 1."""

    def __init__(self, random, servers, points=POINTS):
        self.servers = servers
        self._points = random.random(servers * points)
        self._owners = np.repeat(np.arange(servers), points)[np.argsort(self._points)]
        self._points.sort()

    def without(self, server):
        rest = Ring.__new__(Ring)
        keep = self._owners != server
        rest.servers, rest._points, rest._owners = (
            self.servers, self._points[keep], self._owners[keep])
        return rest

    def homes(self, keys):
        return self._owners[np.searchsorted(self._points, keys) % len(self._owners)]

    def successors(self, key, count):
        """The first `count` different servers from a key on."""
        at, found = int(np.searchsorted(self._points, key)), []
        while len(found) < min(count, self.servers):
            owner = int(self._owners[at % len(self._owners)])
            if owner not in found:
                found.append(owner)
            at += 1
        return found

    def shares(self):
        """The part of the circle that belongs to each server."""
        arcs = np.diff(self._points, prepend=self._points[-1] - 1)
        return np.bincount(self._owners, arcs, self.servers)


class Memories:
    """The memories of all servers, request by request."""

    def __init__(self, servers, capacity):
        self._held = [dict() for _ in range(servers)]  # a dict keeps the order of use
        self._capacity = capacity

    def hits(self, trees, homes):
        """Whether each request found its tree in memory."""
        found = np.zeros(len(trees), bool)
        for i, (tree, home) in enumerate(zip(trees.tolist(), homes.tolist())):
            held = self._held[home]
            if tree in held:
                del held[tree]
                found[i] = True
            elif len(held) >= self._capacity:
                del held[next(iter(held))]
            held[tree] = None
        return found


def simulate_loss(servers, meshes, capacity, exponent, requests):
    """Hit rates by the formula and simulated; hits of the same requests without and with a loss."""
    random = np.random.default_rng(SEED)
    probabilities, _ = zipf(meshes, exponent, meshes)
    cumulated = np.cumsum(probabilities)
    keys = random.random(meshes)
    ring = Ring(random, servers)
    homes = ring.homes(keys)

    def draw(count):
        return np.minimum(np.searchsorted(cumulated, random.random(count)), meshes - 1)

    memories = Memories(servers, capacity)
    memories.hits(*(lambda t: (t, homes[t]))(draw(requests)))  # fills them
    trees = draw(requests)
    survivors = copy.deepcopy(memories)
    whole = memories.hits(trees, homes[trees])
    after = survivors.hits(trees, ring.without(0).homes(keys)[trees])
    return hit_rate(*zipf(meshes, exponent), servers * capacity), whole, after


def unevenness(servers, exponent, copies, rounds=9):
    """Load of the busiest server, as a multiple of the mean: the median of some rings.

    A tree with more than a tenth of a server's share of requests is hot, and has `copies` homes,
    which take its requests in turn; with copies=0 as many as keep each below half a server's share.
    """
    random = np.random.default_rng(SEED)
    probabilities, numbers = zipf(MESHES, exponent)
    single = int((numbers == 1).sum())
    hot = int((probabilities[:single] > 0.1 / servers).sum())
    found = []
    for _ in range(rounds):
        ring = Ring(random, servers)
        keys = random.random(single)
        rest = 1 - probabilities[:single].sum()
        load = np.bincount(ring.homes(keys[hot:]), probabilities[hot:single], servers)
        load = load + rest * ring.shares()
        for tree in range(hot):
            homes = ring.successors(
                keys[tree], copies or int(np.ceil(2 * probabilities[tree] * servers)))
            load[homes] += probabilities[tree] / len(homes)
        found.append(load.max() * servers)
    return float(np.median(found)), hot


def window_means(values, window):
    return values[: len(values) // window * window].reshape(-1, window).mean(axis=1)


def doubling_means(values):
    """Means over 1, 1, 2, 4, 8, ... values: pairs of the middle and the mean."""
    edges = [0] + [1 << i for i in range(len(values).bit_length()) if 1 << i <= len(values)]
    return [((left + right) / 2, values[left:right].mean())
            for left, right in zip(edges, edges[1:])]


def percent(value):
    return f"{value:.1%}"


def hit_table():
    rows = []
    for exponent in EXPONENTS:
        load = zipf(MESHES, exponent)
        rows.append([f"{exponent}"] + [percent(hit_rate(*load, n * CAPACITY)) for n in REPLICAS])
    names = [f"{n} replica{'s' * (n > 1)}" for n in REPLICAS]
    return common.table(["Zipf exponent"] + names, rows), rows


def loss_table():
    rows, curves = [], {}
    for servers, exponent in ((10, 0.8), (10, 1.0), (30, 1.0)):
        formula, whole, after = simulate_loss(
            servers, 10**6, PLACES, exponent, 40 * PLACES * servers)
        window = PLACES
        lost = window_means(whole, window) - window_means(after, window)
        curves[f"{servers} replicas, s = {exponent}"] = doubling_means(lost)
        rows.append([str(servers), f"{exponent}", percent(formula), percent(whole.mean()),
                     percent(lost[0]), percent(lost[len(lost) // 2:].mean()),
                     f"{(whole[:10 * window].sum() - after[:10 * window].sum()) / PLACES:.2f}"])
    return common.table(
        ["Replicas", "Zipf exponent", "Hits by the formula", "Hits simulated",
         "Hits lost in the first 1,000 requests", "Hits lost in the long run",
         "Additional loads in 10,000 requests, for each of the 1,000 trees lost"], rows), curves


def load_table():
    rows = []
    for servers in (3, 10, 100):
        for copies in (1, 2, 4, 8, 0):
            if copies <= servers:
                cells = [unevenness(servers, exponent, copies) for exponent in EXPONENTS]
                rows.append([str(servers), str(copies or "by its load")] + [
                    f"{worst:.2f} ({hot})" for worst, hot in cells])
    return common.table(["Replicas", "Homes of a hot tree"] + [
        f"s = {exponent}" for exponent in EXPONENTS], rows), rows


def plot(hits, curves, loads):
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.3))
    for color, row in zip(COLORS, hits):
        axes[0].plot(REPLICAS, [float(cell[:-1]) for cell in row[1:]], "o-", color=color,
                     label=f"s = {row[0]}")
    axes[0].set(xscale="log", ylim=(0, 100), xlabel="replicas", ylabel="hits in memory, %",
                title="10,000 trees in each memory, 1e8 meshes")
    axes[0].set_xticks(REPLICAS, [str(n) for n in REPLICAS])
    axes[0].minorticks_off()
    for color, (name, lost) in zip(COLORS, curves.items()):
        axes[1].plot([PLACES * at for at, _ in lost], [100 * mean for _, mean in lost], "o-",
                     color=color, label=name)
    axes[1].set(xscale="log", xlabel="requests after the loss", ylabel="hits lost, %",
                ylim=(0, None),
                title="a replica is lost: 1,000 trees each, 1e6 meshes")
    for color, servers in zip(COLORS, (3, 10, 100)):
        points = [(int(row[1]), float(row[3].split()[0])) for row in loads
                  if row[0] == str(servers) and row[1].isdigit()]
        axes[2].plot(*zip(*points), "o-", color=color, label=f"{servers} replicas")
    axes[2].axhline(1, color="grey", lw=0.8)
    axes[2].set(xscale="log", xlabel="homes of a hot tree", ylabel="busiest replica / mean",
                title="load, s = 1.0")
    axes[2].set_xticks((1, 2, 4, 8), ["1", "2", "4", "8"])
    axes[2].minorticks_off()
    for axis in axes:
        axis.title.set_size(9)
        axis.legend(frameon=False)
    common.save(figure, "scale.svg")


def main():
    print(f"seed {SEED}", file=sys.stderr)
    hits, hit_rows = hit_table()
    losses, curves = loss_table()
    loads, load_rows = load_table()
    plot(hit_rows, curves, load_rows)
    common.write_page("scale.md", {"hits": hits, "losses": losses, "loads": loads})


if __name__ == "__main__":
    main()
