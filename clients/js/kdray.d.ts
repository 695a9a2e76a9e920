// SPDX-License-Identifier: Apache-2.0
// Client of kdrayd: ray queries and renders of triangle meshes over HTTP, on typed arrays.
//
// Numbers. A Float32Array is sent as it is, everything else as doubles, and the answer's numbers
// have the type that was sent unless `dtype` says otherwise. Triangle and row numbers are
// Int32Array, counts Uint32Array. A miss has triangle -1 and t Infinity; an invalid row has t NaN.
//
// Batches. A batch of any length is split into requests, which are sent in parallel; the answer is
// in the order of the rows, and the same as that of a single request.
//
// Errors. KdrayError is a refusal, with the server's reason. ConnectionError is a missing answer.
// An aborted signal throws its reason. Invalid arguments throw TypeError or RangeError before
// anything is sent. A request is repeated after a broken connection and after 503, 429, 502 and
// 409 tree_building, whose Retry-After is kept; every request of this client is safe to repeat.

/** A flat typed array, a flat list of numbers, or a list of rows. */
export type NumberRows =
  | Float32Array | Float64Array | Int32Array | Uint32Array | Int16Array | Uint16Array
  | readonly number[] | readonly ArrayLike<number>[];
export type Floats = Float32Array | Float64Array;
export type Vector = readonly [number, number, number] | Float32Array | Float64Array;
export type Color = readonly [number, number, number];

export type Build = 'auto' | 'kd-sah' | 'kd-binned' | 'kd-cyclic' | 'kd-median' | 'bvh' | 'box';
export type Precision = 'auto' | 'fast' | 'watertight' | 'double' | 'exact';
export type UsedPrecision = Exclude<Precision, 'auto'>;

/** A path or file URL (Node only), a File or other Blob, the bytes of a mesh file, or arrays. */
export type MeshSource =
  | string | URL | Blob | ArrayBuffer | Uint8Array
  | { vertices: NumberRows; faces: NumberRows };

export interface ClientOptions {
  /** Bearer token, or a function that returns the present one. */
  token?: string | (() => string | undefined | Promise<string | undefined>);
  /** Requests of one batch at the same time; default 4. */
  parallel?: number;
  /** How often a request is repeated; default 4. */
  retries?: number;
  /**
   * The trace of the requests (W3C Trace Context), or a function that returns the present one.
   * Servers log it beside the request's id.
   */
  traceparent?: string | (() => string | undefined);
  /** In place of globalThis.fetch. */
  fetch?: typeof fetch;
}

/** `loaded` and `total` are bytes, in the phase upload. */
export interface Progress {
  phase: 'upload' | 'build';
  fraction: number;
  loaded?: number;
  total?: number;
}

export interface UploadOptions {
  build?: Build;
  onProgress?: (progress: Progress) => void;
  signal?: AbortSignal;
}

export declare class Client {
  /** The default is http://127.0.0.1:8080. Throws TypeError for an invalid URL. */
  constructor(url?: string | URL, options?: ClientOptions);
  /** The server's version, formats and limits; asked once. */
  capabilities(): Promise<Capabilities>;
  /** Sends the mesh if the server does not have it, and waits for its tree. */
  upload(mesh: MeshSource, options?: UploadOptions): Promise<Tree>;
  /** Another build of a mesh that the server has. */
  rebuild(sha256: string, build: Build, options?: Omit<UploadOptions, 'build'>): Promise<Tree>;
  /** A tree that the server has. KdrayError with code tree_not_found if it has none with this id. */
  tree(id: string, options?: { signal?: AbortSignal }): Promise<Tree>;
  /** All trees, newest first; only those of one mesh with its SHA-256. */
  trees(options?: { mesh?: string; signal?: AbortSignal }): AsyncGenerator<Tree, void, undefined>;
}

export interface BatchOptions {
  /** Time for the answer of each request. */
  deadlineMs?: number;
  /** Type of the answer's numbers. */
  dtype?: 'f4' | 'f8';
  signal?: AbortSignal;
  /** Rows of one request; default 262,144, at most the server's max_rays. */
  batchRows?: number;
}

export interface RayOptions extends BatchOptions {
  precision?: Precision;
  tMin?: number | 'auto';
  tMax?: number | 'auto';
  cull?: 'none' | 'back' | 'front';
  /** Columns of flat input: 6 (default), or 8 with t_min and t_max. */
  columns?: 6 | 8;
}

export type RayField =
  | 't' | 'triangle' | 'u' | 'v' | 'normal' | 'point' | 'side' | 'group' | 'uv' | 'shadingNormal';

/** The column of each field; vectors lie one after the other. */
export interface RayColumns {
  t: Floats;
  triangle: Int32Array;
  u: Floats;
  v: Floats;
  normal: Floats;
  point: Floats;
  side: Int32Array;
  group: Int32Array;
  uv: Floats;
  shadingNormal: Floats;
}

/** What the server says of a batch. */
export interface BatchReport {
  /** Rows. */
  count: number;
  precision: UsedPrecision;
  /** Invalid rows: a number that is not finite, a direction 0, 0, 0, t_min > t_max. */
  invalid: number;
  /** With tMin or tMax auto: the server's Kdray-Offset. */
  offset?: number;
}

export type RayHits<Field extends RayField> = BatchReport & Pick<RayColumns, Field>;
/** Here `count` is the number of hits, and `rays` that of rows. */
export type AllHits<Field extends RayField> = BatchReport & Pick<RayColumns, Field> & {
  /** The row of each hit, ascending. */
  ray: Int32Array;
  rays: number;
  /** Rows with more than maxHits hits; the nearest are kept. */
  truncated: number;
};
export type Values<Column> = BatchReport & { values: Column };

export interface PointOptions extends BatchOptions {
  precision?: 'auto' | 'double' | 'exact';
}

export type PointField = 'distance' | 'point' | 'triangle' | 'u' | 'v' | 'normal';
export interface PointColumns {
  distance: Floats;
  point: Floats;
  triangle: Int32Array;
  u: Floats;
  v: Floats;
  normal: Floats;
}
export type NearestPoints<Field extends PointField> = BatchReport & Pick<PointColumns, Field>;

export interface VisibilityOptions {
  precision?: Precision;
  tMin?: number | 'auto';
  tMax?: number | 'auto';
  cull?: 'none' | 'back' | 'front';
  /** The second set are directions, and the rays have no end. */
  toDirections?: boolean;
  deadlineMs?: number;
  signal?: AbortSignal;
  /** Pairs of one request. */
  batchRows?: number;
}

export interface Visibility {
  from: number;
  to: number;
  /** Row by row, `from` rows of `to` bytes: 1 where the pair sees each other. */
  visible: Uint8Array;
  precision: UsedPrecision;
  invalid: number;
  offset?: number;
}

export interface Light {
  direction?: Vector;
  position?: Vector;
  intensity?: number;
  color?: Color;
}

/** The fields of a render, as the contract describes them (GET /docs). */
export interface RenderFields {
  width?: number;
  height?: number;
  projection?: 'perspective' | 'orthographic' | 'spherical';
  eye?: Vector;
  target?: Vector;
  up?: Vector;
  view?: 'iso' | 'front' | 'back' | 'left' | 'right' | 'top' | 'bottom';
  fovDeg?: number;
  viewHeight?: number;
  hFovDeg?: number;
  vFovDeg?: number;
  /** fx, fy, cx, cy in pixels. */
  intrinsic?: readonly number[] | Floats;
  /** 16 numbers, world to camera, row by row. */
  extrinsic?: readonly number[] | Floats;
  mode?: 'shaded' | 'normal' | 'depth' | 'triangle' | 'ambient-occlusion' | 'cost' | 'position';
  depthRange?: readonly [number, number];
  samples?: number;
  precision?: Precision;
  color?: Color | 'file';
  background?: Color | 'transparent';
  lights?: readonly Light[];
  shadows?: boolean;
  smooth?: boolean;
  aoRadius?: number;
  edges?: boolean;
  cellsDepth?: number;
  region?: readonly [number, number, number, number];
  seed?: number;
  budgetMs?: number;
  maxNoise?: number;
  maxSamples?: number;
  deadlineMs?: number;
}
export interface RenderOptions extends RenderFields {
  signal?: AbortSignal;
}

export interface RenderReport {
  precision: UsedPrecision;
  samples: number;
  noise?: number;
  stopped: 'done' | 'noise' | 'budget';
  depthRange?: [number, number];
}
export interface Picture extends RenderReport {
  /** The PNG file. */
  bytes: Uint8Array;
  type: 'image/png';
  /** For pages: URL.createObjectURL(picture.blob()). */
  blob(): Blob;
}
export interface ImageArray extends RenderReport {
  /** C order; row 0 is the top. */
  data: Float32Array | Float64Array | Int32Array;
  /** [height, width], or [height, width, values of a pixel]. */
  shape: number[];
}

export type ScanOptions = Pick<
  RenderOptions,
  | 'eye' | 'target' | 'up' | 'hFovDeg' | 'vFovDeg' | 'width' | 'height' | 'precision' | 'region'
  | 'deadlineMs' | 'signal'
>;
export interface Scan {
  count: number;
  width: number;
  height: number;
  /** x, y, z of each hit; misses are left out. */
  points: Float64Array;
  /** The pixel of each hit: row * width + column. */
  pixels: Uint32Array;
  precision: UsedPrecision;
}

export interface BeamOptions extends Omit<RayOptions, 'columns' | 'dtype'> {
  eye: Vector;
  /** The azimuth 0 is towards it; default the middle of the mesh's bounds. */
  target?: Vector;
  /** Default 0, 1, 0. */
  up?: Vector;
  /** Elevations of the beams over the plane at a right angle to `up`. */
  elevationsDeg: readonly number[] | Floats;
  /** Azimuths of each beam, at the middles of `width` equal parts of hFovDeg; default 1024. */
  width?: number;
  /** Default 360. */
  hFovDeg?: number;
}
export interface BeamHits {
  count: number;
  points: Float64Array;
  /** Distances from the eye. */
  ranges: Float64Array;
  triangles: Int32Array;
  /** The index of each hit's elevation, and of its azimuth. */
  beams: Uint32Array;
  columns: Uint32Array;
  precision: UsedPrecision;
}

export declare class Tree {
  constructor(client: Client, description: TreeDescription);
  readonly client: Client;
  description: TreeDescription;
  readonly id: string;
  /** Asks for the description again. */
  refresh(options?: { signal?: AbortSignal }): Promise<this>;

  /** The closest hit of each ray (rows ox oy oz dx dy dz, or with t_min t_max after them). */
  closest<Field extends RayField = 't' | 'triangle' | 'u' | 'v'>(
    rays: NumberRows, options?: RayOptions & { fields?: Field[] },
  ): Promise<RayHits<Field>>;
  /** 1 for each ray that hits anything. */
  any(rays: NumberRows, options?: RayOptions): Promise<Values<Uint8Array>>;
  /** The number of triangles that each ray hits. */
  count(rays: NumberRows, options?: RayOptions): Promise<Values<Uint32Array>>;
  /** All hits of all rays, by row, then t, then triangle. */
  all<Field extends RayField = 't' | 'triangle' | 'u' | 'v'>(
    rays: NumberRows, options?: RayOptions & { fields?: Field[]; maxHits?: number },
  ): Promise<AllHits<Field>>;

  /** The closest point of the mesh for each point (rows x y z). */
  closestPoints<Field extends PointField = 'distance' | 'point' | 'triangle' | 'u' | 'v'>(
    points: NumberRows, options?: PointOptions & { fields?: Field[] },
  ): Promise<NearestPoints<Field>>;
  /** Negative inside; NaN where the answer is unknown. */
  signedDistance(points: NumberRows, options?: PointOptions): Promise<Values<Floats>>;
  /** 1 inside, 0 outside, -1 where the answer is unknown. */
  inside(points: NumberRows, options?: PointOptions): Promise<Values<Int8Array>>;
  /** Which points of two sets see each other. */
  visibility(from: NumberRows, to: NumberRows, options?: VisibilityOptions): Promise<Visibility>;

  /** A PNG. */
  render(options?: RenderOptions): Promise<Picture>;
  /** Depths, triangle numbers, normals, points or colours as an array. */
  renderArray(options?: RenderOptions): Promise<ImageArray>;
  /** The address of a PNG, for <img src>; it contains no token. */
  renderUrl(fields?: RenderFields): string;
  /** The points that a lidar at `eye` sees: the pixels of a spherical image that hit. */
  scan(options?: ScanOptions): Promise<Scan>;
  /** The same for a list of elevations, as lidars with uneven beams have it. */
  scanBeams(options: BeamOptions): Promise<BeamHits>;

  /** Measures speed and accuracy of every build and precision on this mesh; takes some seconds. */
  tradeoff(options?: {
    onProgress?: (fraction: number) => void; signal?: AbortSignal;
  }): Promise<Tradeoff>;
  /** The boxes of the tree's nodes at this depth and of leaves above it. */
  cells(depth: number, options?: { signal?: AbortSignal }): Promise<Cell[]>;
  /** The uploaded bytes. */
  mesh(options?: { signal?: AbortSignal }): Promise<Uint8Array>;
  /** Deletes the tree; the mesh goes with its last tree. */
  delete(options?: { signal?: AbortSignal }): Promise<void>;
}

/** The server refused the request. `message` is the code and the reason. */
export declare class KdrayError extends Error {
  constructor(status: number, problem: object, requestId: string | null);
  status: number;
  /** As the contract lists them, e.g. tree_not_found; absent for answers of a proxy. */
  code: string | undefined;
  detail: string | undefined;
  parameter: string | undefined;
  limit: number | undefined;
  actual: number | undefined;
  line: number | undefined;
  requestId: string | undefined;
}

/**
 * There was no answer, or it broke off, in every try; `cause` is that of the last. The log of a
 * server that got the request has `requestId`.
 */
export declare class ConnectionError extends Error {
  constructor(url: string, cause: unknown, requestId?: string | null);
  requestId: string | undefined;
}

/** The bytes of a binary PLY file: what upload() sends for { vertices, faces }. */
export declare function plyOf(vertices: NumberRows, faces: NumberRows): Uint8Array;

export interface Capabilities {
  name: string;
  version: string;
  formats: string[];
  builds: string[];
  precisions: string[];
  limits: { max_rays: number; max_pixels: number; max_upload_bytes: number; [name: string]: number };
}

/** Fields are those of the contract; later versions may add more. */
export interface TreeDescription {
  id: string;
  state: 'building' | 'ready';
  progress: number;
  created_at: string;
  mesh: {
    sha256: string;
    bytes: number;
    format?: string;
    triangles?: number;
    dropped?: number;
    vertices?: number;
    bounds?: { min: [number, number, number]; max: [number, number, number] };
    health?: {
      degenerate: number;
      duplicate: number;
      concave: number;
      open_edges: number;
      non_manifold_edges: number;
      closed: boolean;
      coordinate_resolution: number;
    };
    groups?: string[];
    area?: number;
    volume?: number;
  };
  tree?: {
    build: Exclude<Build, 'auto'>;
    nodes: number;
    leaves: number;
    empty_leaves: number;
    references: number;
    max_depth: number;
    leaf_histogram: number[];
    max_leaf: number;
    bytes: number;
    sah_cost: number;
    traversal_cost: number;
    intersection_cost: number;
    parse_ms: number;
    build_ms: number;
  };
  plan?: string;
}

export interface Cell {
  min: [number, number, number];
  max: [number, number, number];
  depth: number;
  leaf: boolean;
  triangles: number;
}

export interface RayCost {
  rays_per_s: number;
  slowest: number;
  fastest: number;
  nodes_per_ray: number;
  triangles_per_ray: number;
}
export interface ErrorRate {
  count: number;
  rays: number;
  rate: number;
  below?: number;
}
export interface TradeoffRow {
  build: Exclude<Build, 'auto'>;
  precision: UsedPrecision;
  build_ms: number;
  bytes: number;
  sah_cost: number;
  random: RayCost;
  aimed: RayCost;
  leaks: ErrorRate | null;
  wrong_triangles: ErrorRate;
  unconnected_triangles: ErrorRate;
  folds: ErrorRate;
  missed_hits: ErrorRate;
  extra_hits: ErrorRate;
  differences: ErrorRate;
  t_error: { rays: number; p999: number; max: number; bound: number | null };
}
export interface Tradeoff {
  state: 'measured';
  progress: number;
  measured_at: string;
  mesh: { triangles: number; closed: boolean };
  conditions: {
    threads: number;
    load_average: number;
    runs: number;
    disturbed_runs: number;
    aimed_from_inside: boolean;
    seed: number;
    total_ms: number;
  };
  results: TradeoffRow[];
}
