// SPDX-License-Identifier: Apache-2.0
// How the picture is made: the fields above it, as a render query and as part of a link.
import { addOptions, byId, chooseOption } from './dom.js';
import { parseNumbers } from './camera.js';
import { LIGHTS, lightsText } from './lights.js';

// Of the contract, which names them; `position` has no picture.
const MODES = ['shaded', 'normal', 'depth', 'triangle', 'ambient-occlusion', 'cost'];
const DEEPEST_CELLS = 24; // a slider with more steps cannot be aimed; deeper cells are specks

/** The checkboxes, by the name of their parameter: what a link says when they are set. */
const SWITCHES = { shadows: 'true', smooth: 'true', color: 'file', edges: 'true' };
const OF_SHADED = ['shadows', 'smooth', 'color'];

export class Settings {
  /**
   * @param onChange called after the user has changed a field; with {moving: true} while a slider
   *     is moved, with {isChoice: true} for a change that the Back button should undo
   */
  constructor(onChange) {
    addOptions(byId('mode'), MODES);
    addOptions(byId('light'), LIGHTS);
    byId('cells').max = DEEPEST_CELLS;
    const choices = ['mode', 'precision', 'light', ...Object.keys(SWITCHES)];
    for (const id of choices) {
      byId(id).addEventListener('change', () => {
        this.adapt();
        onChange({ isChoice: true });
      });
    }
    for (const id of ['cells', 'sun-azimuth', 'sun-elevation']) {
      byId(id).addEventListener('input', () => {
        this.adapt();
        onChange({ moving: true });
      });
    }
    byId('tools').addEventListener('submit', (event) => event.preventDefault());
    this.adapt();
  }

  get mode() {
    return byId('mode').value;
  }

  set mode(name) {
    byId('mode').value = name;
    this.adapt();
  }

  /** The chosen depth of cells; null without. */
  get cellsDepth() {
    const depth = Number(byId('cells').value);
    return depth < 0 ? null : depth;
  }

  set cellsDepth(depth) {
    byId('cells').value = depth ?? -1;
    this.adapt();
  }

  get sun() {
    return {
      azimuth: Number(byId('sun-azimuth').value),
      elevation: Number(byId('sun-elevation').value),
    };
  }

  offerPrecisions(names) {
    addOptions(byId('precision'), names);
  }

  /** Depths at which this tree has cells, and no more than a picture may show. */
  limitCells(tree, maxCells) {
    // At depth d there are at most 2^d nodes, and never more than the tree has leaves.
    const safe = tree.leaves <= maxCells ? Infinity : Math.floor(Math.log2(maxCells));
    byId('cells').max = Math.min(tree.max_depth, DEEPEST_CELLS, safe);
    const isKdTree = tree.build.startsWith('kd-');
    byId('cells').title = isKdTree
      ? `Cells of build=${tree.build}`
      : `Boxes of build=${tree.build}; build=kd-sah has the cells of a kd-tree`;
    this.adapt();
  }

  precisionQuery() {
    const precision = byId('precision').value;
    return !precision || precision === 'auto' ? {} : { precision };
  }

  /** The fields of a render request, without the camera's. */
  query(upAxis) {
    const query = { mode: this.mode, ...this.precisionQuery() };
    for (const [name, value] of Object.entries(SWITCHES))
      if (byId(name).checked && !byId(name).disabled) query[name] = value;
    const lights = this.mode === 'shaded' && lightsText(byId('light').value, upAxis, this.sun);
    if (lights) query.lights = lights;
    if (this.cellsDepth !== null) query.cells_depth = this.cellsDepth;
    return query;
  }

  /** What a link needs to restore() all this. */
  values() {
    const values = { mode: this.mode, ...this.precisionQuery() };
    for (const [name, value] of Object.entries(SWITCHES))
      if (byId(name).checked) values[name] = value;
    if (byId('light').value !== LIGHTS[0]) values.light = byId('light').value;
    if (byId('light').value === 'sun') values.sun = Object.values(this.sun).join();
    if (this.cellsDepth !== null) values.cells_depth = this.cellsDepth;
    return values;
  }

  /** Unknown values in a link are ignored: the fields then have their defaults. */
  restore(values) {
    const defaults = { mode: MODES[0], precision: 'auto', light: LIGHTS[0] };
    for (const [id, value] of Object.entries(defaults))
      if (!chooseOption(byId(id), values[id])) chooseOption(byId(id), value);
    for (const [name, value] of Object.entries(SWITCHES))
      byId(name).checked = values[name] === value;
    const sun = parseNumbers(values.sun, 2);
    if (sun) [byId('sun-azimuth').value, byId('sun-elevation').value] = sun;
    const depth = Number(values.cells_depth ?? NaN);
    byId('cells').max = DEEPEST_CELLS; // until the tree's own depth is known
    this.cellsDepth = Number.isInteger(depth) && depth >= 0 ? depth : null;
  }

  /** Shows what the values mean, and switches off what the mode does not use. */
  adapt() {
    byId('cells-depth').value = this.cellsDepth ?? 'off';
    const isShaded = this.mode === 'shaded';
    for (const id of ['light', ...OF_SHADED]) byId(id).disabled = !isShaded;
    byId('sun').hidden = byId('light').value !== 'sun';
    for (const id of ['sun-azimuth', 'sun-elevation']) byId(id).disabled = !isShaded;
    // A headlight's shadows are behind what the eye sees.
    if (byId('light').value === 'headlight') byId('shadows').disabled = true;
  }
}
