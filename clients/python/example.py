"""Uploads a mesh, queries rays and writes a picture: example.py MESH [SERVER]"""
import io
import json
import sys
from urllib.request import urlopen

import numpy as np

mesh = sys.argv[1]
trees = (sys.argv[2] if len(sys.argv) > 2 else "http://127.0.0.1:8080") + "/v1/trees"

with open(mesh, "rb") as file:
    tree = json.load(urlopen(trees, file.read()))  # safe to repeat: the id is a digest
low, high = (np.array(tree["mesh"]["bounds"][end]) for end in ("min", "max"))

# 500 x 500 rays from above, straight down the y axis.
rays = np.zeros((500, 500, 6), "f4")
rays[..., 0], rays[..., 2] = np.meshgrid(*(np.linspace(low[i], high[i], 500) for i in (0, 2)))
rays[..., 1], rays[..., 4] = high[1] + 1, -1
body = io.BytesIO()
np.save(body, rays)
answer = urlopen(f"{trees}/{tree['id']}/rays/closest?fields=t,triangle", body.getvalue())
hits = np.load(io.BytesIO(answer.read()))  # shape (500, 500), fields t and triangle

hit = hits["triangle"] >= 0
print(f"{hit.mean():.1%} of {hit.size} rays hit, the nearest at t = {hits['t'].min():.4f}")
with open("picture.png", "wb") as file:
    file.write(urlopen(f"{trees}/{tree['id']}/render.png?width=800&height=600").read())
