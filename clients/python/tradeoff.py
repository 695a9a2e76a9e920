"""Prints the speed and accuracy that the server measures on a mesh: tradeoff.py MESH [SERVER]"""
import json
import sys
from urllib.request import Request, urlopen

mesh = sys.argv[1]
trees = (sys.argv[2] if len(sys.argv) > 2 else "http://127.0.0.1:8080") + "/v1/trees"

with open(mesh, "rb") as file:
    tree = json.load(urlopen(trees, file.read()))["id"]
answer = json.load(urlopen(Request(f"{trees}/{tree}/tradeoff?wait_ms=0", method="POST")))
while answer["state"] == "measuring":
    print(f"\rmeasuring {answer['progress']:4.0%}", end="", file=sys.stderr, flush=True)
    answer = json.load(urlopen(f"{trees}/{tree}/tradeoff?wait_ms=500"))
print("\r", end="", file=sys.stderr)


def rate(errors):
    """A share; a zero with its bound at 95% confidence."""
    if errors is None:
        return "-"
    return f"< {errors['below']:.1e}" if errors["count"] == 0 else f"{errors['rate']:.1e}"


print(f"{'build':10} {'precision':10} {'Mrays/s':>8} {'leaks':>10} {'t error':>10}")
for row in answer["results"]:
    print(f"{row['build']:10} {row['precision']:10} {row['random']['rays_per_s'] / 1e6:8.2f} "
          f"{rate(row['leaks']):>10} {row['t_error']['p999']:10.1e}")
