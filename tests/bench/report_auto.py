# SPDX-License-Identifier: Apache-2.0
"""The report of the benchmark of `auto`: expected costs against measured speeds."""
from report_common import BUILD_COLORS, conditions, geometric_mean, plt, save, table, write_section

SMALL = 1000  # triangles: below, a picture's worth of rays takes so little time that speeds are noise
KD_SAH_FACTOR = 4 / 3  # AutoChoice::kKdSahFactor: a ray's time at equal cost
CLOSE = 0.05  # a choice that loses less is as good as the other


def speed_of(row, build):
    return float(row["bvh_mrays_s" if build == "bvh" else "kd_mrays_s"])


def loss(row):
    """How much slower rays are with the choice than with the better build; 0 if it is the better."""
    best = max(speed_of(row, "bvh"), speed_of(row, "kd-sah"))
    return best / speed_of(row, row["pick"]) - 1


def cost_loss(row):
    costs = {"bvh": float(row["bvh_cost"]), "kd-sah": KD_SAH_FACTOR * float(row["kd_cost"])}
    return costs[row["pick"]] / min(costs.values()) - 1


def build_ms(row):
    bvh, kd = float(row["bvh_build_ms"]), float(row["kd_build_ms"])
    return float(row["overlap_ms"]) + (bvh + kd if row["compared"] == "1" else bvh)


def plot(rows):
    figure, axes = plt.subplots(figsize=(6.4, 4.4))
    for compared, marker, label in (("0", "o", "bvh without a comparison"), ("1", "^", "both built")):
        for pick in ("bvh", "kd-sah"):
            mine = [row for row in rows if row["compared"] == compared and row["pick"] == pick]
            if not mine:
                continue
            axes.scatter([float(row["kd_cost"]) / float(row["bvh_cost"]) for row in mine],
                         [float(row["bvh_to_kd"]) for row in mine], s=14, marker=marker,
                         color=BUILD_COLORS[pick], label=f"{label}, took {pick}" if compared == "1" else label)
    axes.axhline(1, color="black", linewidth=0.7)
    axes.axvline(1, color="black", linewidth=0.7)
    axes.set(xscale="log", yscale="log", xlabel="expected cost of kd-sah / of bvh",
             ylabel="speed of rays in bvh / in kd-sah")
    axes.legend(fontsize=8)
    save(figure, "auto.svg")


def auto(rows, command):
    plot(rows)
    large = [row for row in rows if int(row["triangles"]) >= SMALL]
    compared = [row for row in large if row["compared"] == "1"]
    wrong = [row for row in large if loss(row) > CLOSE]
    worst = sorted(large, key=loss, reverse=True)[:8]

    def to(build):
        return geometric_mean(speed_of(row, row["pick"]) / speed_of(row, build) for row in large)
    best = geometric_mean(1 / (1 + loss(row)) for row in large)
    kd_to_bvh = geometric_mean(speed_of(row, "kd-sah") / speed_of(row, "bvh") for row in large)
    time = geometric_mean(build_ms(row) / float(row["kd_build_ms"]) for row in large)
    time_compared = geometric_mean(build_ms(row) / float(row["kd_build_ms"]) for row in compared)
    costs = [row for row in large if cost_loss(row) > CLOSE]
    write_section("auto", f"""
{conditions(command)} {len(rows)} meshes; figures are of the {len(large)} with at least {SMALL:,} triangles. The speed of a mesh is the
geometric mean of six classes of rays.

![Expected costs against measured speeds](../../docs/auto.svg)

`auto` took kd-sah for {sum(row['pick'] == 'kd-sah' for row in large)} of them and bvh for {sum(row['pick'] == 'bvh' for row in large)}; for {len(compared)} it built both.
Rays were {to('kd-sah'):.2f} times as fast as in kd-sah, {to('bvh'):.2f} times as fast as in bvh, and {best:.3f} times as fast as in the better one of
each mesh (geometric means). kd-sah was {kd_to_bvh:.2f} times as fast as bvh. The build took {time:.2f} times as long as that of kd-sah, and
{time_compared:.2f} times where both were built. The choice lost more than {CLOSE:.0%} of the speed on {len(wrong)} mesh{'' if len(wrong) == 1 else 'es'}, and more than {CLOSE:.0%} of the
expected time on {len(costs)}.

{table(['largest losses', 'triangles', 'overlap', 'choice', 'both built', 'expected cost: bvh', 'kd-sah', 'speed of bvh to kd-sah', 'loss'],
       [[row['mesh'], f"{int(row['triangles']):,}", f"{float(row['overlap']):.1f}", row['pick'],
         'yes' if row['compared'] == '1' else 'no', f"{float(row['bvh_cost']):.1f}", f"{float(row['kd_cost']):.1f}",
         f"{float(row['bvh_to_kd']):.2f}", f"{loss(row):.0%}"] for row in worst])}
""")
