# SPDX-License-Identifier: Apache-2.0
"""The viewer page in a real browser: trees, rays and the trade-off, compared with the service."""
import numpy as np

from page import SETTLED, PageTest, main

PRECISIONS = ["fast", "watertight", "double", "exact"]


class BrowserInspectTest(PageTest):
    def ray(self):
        """The ray of the page's address as a row."""
        return [float(number) for number in self.link()["ray"].split(",")]

    def hits(self, **options):
        query = "&".join(f"{name}={value}" for name, value in options.items())
        path = f"/v1/trees/{self.tree}/rays/closest?{query}"
        return self.ask(path, {"rays": [self.ray()]})["results"][0]

    def test_the_panel_of_a_ray_says_what_the_service_answers(self):
        self.open_tree()
        self.shoot()
        facts = self.facts("#hit-facts")
        hit = self.hits(fields="t,triangle,u,v,normal,point,side")
        self.assertEqual(facts["Triangle"].replace(",", ""), str(hit["triangle"]))
        self.assertEqual(facts["Side"], {1: "front", -1: "back"}[hit["side"]])
        self.assertAlmostEqual(float(facts["Distance t"]), hit["t"], delta=1e-8 * hit["t"])
        point = [float(x) for x in facts["Point"].split(",")]
        np.testing.assert_allclose(point, hit["point"], rtol=1e-5, atol=1e-5)
        count = self.ask(f"/v1/trees/{self.tree}/rays/count", {"rays": [self.ray()]})["results"][0]
        self.assertEqual(facts["Crossings"], str(count))

    def test_it_shows_what_each_precision_answers(self):
        self.open_tree()
        self.shoot()
        rows = self.table("#precision-table")
        self.assertEqual([row[0] for row in rows], PRECISIONS)
        exact = self.hits(precision="exact")
        for precision, triangle, t, error in rows:
            with self.subTest(precision):
                hit = self.hits(precision=precision)
                self.assertEqual(triangle.replace(",", ""), str(hit["triangle"]))
                self.assertAlmostEqual(float(t), hit["t"], delta=1e-11 * hit["t"])
                if precision != "exact":
                    difference = hit["t"] - exact["t"]
                    self.assertAlmostEqual(float(error), difference, delta=0.06 * abs(difference))
        self.browser.choose("#precision", "exact")
        self.wait_text("#hit-facts", "exact")

    def test_it_names_the_group_of_a_hit(self):
        mesh = f"{self.daemon.folder}/groups.obj"
        with open(mesh, "w") as file:
            file.write("v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n"
                       "o lower\nf 1 2 3\no upper & <left>\nf 1 3 4\n")
        browser = self.open_tree(mesh)
        self.assertIn("Groups (2)", self.text("#groups"))
        browser.choose("#side", "top")  # what is flat lies on the ground
        browser.wait(SETTLED)
        for place, name in (((-40, -60), "upper & <left>"), ((40, 60), "lower")):
            self.shoot(place)
            browser.wait("return document.querySelector('#hit-group').textContent !== '…'")
            self.assertEqual(self.facts("#hit-facts")["Group"], name)
        self.assertEqual(browser.errors(), [])

    def test_the_cells_of_a_ray_are_those_that_its_points_lie_in(self):
        browser = self.open_tree()
        for build, depth in (("kd-sah", 7), ("bvh", 5), ("kd-median", 9)):
            with self.subTest(build):
                self.tree = self.kdray("upload", self.teapot, "--build", build)
                cells = self.ask(f"/v1/trees/{self.tree}/cells?depth={depth}")["cells"]
                lows, highs = (np.array([cell[end] for cell in cells]) for end in ("min", "max"))
                origin, direction = np.array([5, 2.1, 3.3]), np.array([-0.8, -0.25, -0.55])
                found = browser.run("""const { cellsAlong } = await import('./ray_cells.js');
                    return cellsAlong(arguments[0], arguments[1])""", cells,
                                    {"origin": origin.tolist(), "direction": direction.tolist()})
                inside = [np.all((lows < point) & (point < highs), axis=1)
                          for point in origin + np.linspace(0, 20, 20001)[:, None] * direction]
                boxes = np.hstack([lows, highs])
                met = set(map(tuple, boxes[np.any(inside, axis=0)]))
                self.assertLessEqual(met, {(*cell["min"], *cell["max"]) for cell in found})
                self.assertGreater(len(found), 3)
                for cell in found:
                    middle = origin + 0.5 * (cell["from"] + cell["to"]) * direction
                    self.assertTrue(np.all(np.array(cell["min"]) <= middle))
                    self.assertTrue(np.all(middle <= np.array(cell["max"])))
                entries = [cell["from"] for cell in found]
                self.assertEqual(entries, sorted(entries))

    def test_the_cells_that_a_ray_passes_follow_the_depth_of_the_picture(self):
        browser = self.open_tree()
        self.shoot()
        self.assertIn(" cell", self.text("#ray-cells-words"))
        self.change(lambda: browser.choose("#cells", "4"))
        build = self.ask(f"/v1/trees/{self.tree}")["tree"]["build"]
        self.wait_text("#ray-cells-words", f"At depth 4 of {build} ")
        self.assertGreater(self.count("#ray-cells-strip rect"), 1)
        drawn = browser.run("""const canvas = document.querySelector('#overlay');
            return canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height)
                .data.some((x) => x > 0)""")
        self.assertTrue(drawn)
        browser.click("#clear-ray")
        self.assertFalse(self.is_shown("#marker"))
        self.assertNotIn("ray", self.link())

    def test_the_slider_of_cells_says_whose_cells_they_are(self):
        browser = self.open_tree()
        browser.choose("#rebuild", "bvh")
        browser.wait("return document.querySelector('#cells').title.startsWith('Boxes of build=bvh;')")
        browser.choose("#rebuild", "kd-sah")
        browser.wait("return document.querySelector('#cells').title === 'Cells of build=kd-sah'")
        self.assertTrue(self.link()["tree"].endswith("-kd-sah"))

    def test_the_tree_has_statistics_and_a_histogram_of_its_leaves(self):
        browser = self.open_tree()
        browser.click("#tab-tree")
        tree = self.ask(f"/v1/trees/{self.tree}")["tree"]
        facts = self.facts("#tree-facts")
        for name, field in (("Nodes", "nodes"), ("Leaves", "leaves"), ("References", "references"),
                            ("Depth", "max_depth"), ("Largest leaf", "max_leaf")):
            self.assertEqual(facts[name].replace(",", ""), str(tree[field]))
        bars = browser.run("""return [...document.querySelectorAll('#leaves .leaf-bar')]
            .map((bar) => Number(bar.querySelector('rect:last-child').getAttribute('height')))""")
        self.assertEqual(len(bars), len(tree["leaf_histogram"]))
        peak = int(np.argmax(tree["leaf_histogram"]))
        self.assertEqual(int(np.argmax(bars)), peak)
        leaves = tree["leaf_histogram"]
        self.assertEqual([bar > 0 for bar in bars], [number > 0 for number in leaves])

    def test_the_slider_never_asks_for_more_cells_than_a_picture_may_have(self):
        browser = self.open_tree()
        depth = browser.run("return Number(document.querySelector('#cells').max)")
        self.assertGreater(depth, 9)
        self.change(lambda: browser.choose("#cells", str(depth)))
        self.assertEqual(self.text("#cells-depth"), str(depth))
        self.assertEqual(browser.errors(), [])

    def test_the_cost_of_each_pixel_has_a_legend(self):
        browser = self.open_tree()
        browser.click("#tab-tree")
        before, after = self.change(lambda: browser.click("#show-cost"))
        self.assertNotEqual(before, after)
        self.assertTrue(self.is_shown("#legend"))
        # The contract's level is log2(1 + cost) / 10.
        self.assertEqual(self.texts("#legend-labels span"), ["0", "5", "31", "180", "1023+"])
        self.change(lambda: browser.choose("#mode", "depth"))
        self.assertIn("Distance", self.text("#legend"))
        self.change(lambda: browser.choose("#mode", "shaded"))
        self.assertFalse(self.is_shown("#legend"))

    def test_the_trade_off_is_measured_and_plotted(self):
        browser = self.open_tree(self.sample("cube.ply"))
        browser.click("#tab-tradeoff")
        browser.run("""window.parts = [];
            const part = document.querySelector('#tradeoff-part');
            new MutationObserver(() => parts.push(part.textContent)).observe(part, {childList: true});
            """)
        browser.click("#measure")
        self.wait_shown("#tradeoff-result", seconds=60)
        self.assertTrue(any("%" in part for part in browser.run("return window.parts")))
        results = self.ask(f"/v1/trees/{self.tree}/tradeoff")["results"]
        rows = self.table("#tradeoff-table")
        names = [f"{row['build']} {row['precision']}" for row in results]
        self.assertEqual([row[0] for row in rows], names)
        self.assertEqual([row[3] for row in rows], [str(row["leaks"]["count"]) for row in results])
        marks = "return document.querySelectorAll('#tradeoff-plot > svg .mark').length"
        self.assertEqual(browser.run(marks), len(results))
        browser.choose("#accuracy", "leaks")
        self.assertEqual(browser.run(marks), len(results))
        self.assertEqual(browser.errors(), [])
        # Whoever gets the link sees the result.
        self.assertEqual(self.link()["measured"], "1")
        fragment = browser.run("const {hash} = location; localStorage.clear(); return hash")
        self.open_page(fragment)
        self.wait_shown("#tradeoff-result")

    def test_a_measurement_can_be_stopped(self):
        browser = self.open_tree()
        browser.click("#tab-tradeoff")
        browser.click("#measure")
        self.wait_shown("#tradeoff-progress")
        browser.click("#stop")
        self.wait_shown("#tradeoff-start")
        browser.click("#look")
        self.wait_text("#tradeoff-words", "not been measured")


if __name__ == "__main__":
    main()
