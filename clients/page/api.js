// The service's HTTP contract as functions. URLs are relative to the page, so that it also works
// where a proxy puts the service under a path of its own.

const TOKEN_KEY = 'kdray-token';

/** The server's problem+json, or a substitute for an answer without one. */
export class ApiError extends Error {
  constructor(status, problem, requestId) {
    super(problem.detail || problem.title || `HTTP ${status}`);
    this.status = status;
    this.code = problem.code || `HTTP ${status}`;
    this.line = problem.line;
    this.parameter = problem.parameter;
    this.requestId = problem.request_id || requestId;
  }
}

/** There was no answer. */
export class ConnectionError extends Error {
  constructor() {
    super('The server cannot be reached, or closed the connection.');
    this.code = 'no connection';
  }
}

export class Api {
  /** `askForToken` asks the user for a token; it is called on 401. */
  constructor(askForToken) {
    this.base = new URL('.', document.baseURI);
    this.askForToken = askForToken;
    this.token = sessionStorage.getItem(TOKEN_KEY) || '';
  }

  url(path, query = {}) {
    const url = new URL(path, this.base);
    // Commas stay readable: the query is also shown to people, in the curl command.
    url.search = new URLSearchParams(query).toString().replaceAll('%2C', ',');
    return url;
  }

  headers() {
    return this.token ? { Authorization: `Bearer ${this.token}` } : {};
  }

  /** Repeats the request with a new token if the token was missing or invalid. */
  async fetch(path, { query, ...options } = {}) {
    for (;;) {
      const sent = this.token;
      const response = await this.send(this.url(path, query), options);
      if (response.ok) return response;
      const error = await errorOf(response);
      if (error.status !== 401) throw error;
      await this.renewToken(sent);
    }
  }

  async send(url, options) {
    try {
      return await fetch(url, { ...options, headers: { ...options.headers, ...this.headers() } });
    } catch (error) {
      throw error.name === 'AbortError' ? error : new ConnectionError();
    }
  }

  /** One dialog for all requests that got 401 at the same time. */
  async renewToken(refused) {
    if (this.token !== refused) return;
    this.asking ??= this.askForToken().finally(() => (this.asking = null));
    this.token = await this.asking;
    sessionStorage.setItem(TOKEN_KEY, this.token);
  }

  async json(path, options) {
    return (await this.fetch(path, options)).json();
  }

  info() {
    return this.json('v1');
  }

  trees(after) {
    return this.json('v1/trees', { query: after ? { after } : {} });
  }

  tree(id, waitMs = 0) {
    return this.json(treePath(id), { query: waitMs ? { wait_ms: waitMs } : {} });
  }

  anotherBuild(sha256, build) {
    const query = { mesh: sha256, build, wait_ms: 100 };
    return this.json('v1/trees', { method: 'POST', query });
  }

  deleteTree(id) {
    return this.fetch(treePath(id), { method: 'DELETE' });
  }

  render(id, query, signal) {
    return this.fetch(`${treePath(id)}/render.png`, { query, signal });
  }

  closestHit(id, ray, query) {
    return this.json(`${treePath(id)}/rays/closest`, {
      method: 'POST',
      query,
      headers: { 'Content-Type': 'application/json' },
      body: rayBody(ray),
    });
  }

  /** POST of a file. XMLHttpRequest, because fetch does not report the progress of an upload. */
  async upload(file, build, onProgress) {
    for (;;) {
      const sent = this.token;
      try {
        return await this.uploadOnce(file, build, onProgress);
      } catch (error) {
        if (error.status !== 401) throw error;
        await this.renewToken(sent);
      }
    }
  }

  uploadOnce(file, build, onProgress) {
    return new Promise((resolve, reject) => {
      const request = new XMLHttpRequest();
      request.open('POST', this.url('v1/trees', { build, wait_ms: 100 }));
      for (const [name, value] of Object.entries(this.headers()))
        request.setRequestHeader(name, value);
      request.setRequestHeader('Content-Type', 'application/octet-stream');
      request.upload.onprogress = (event) => onProgress(event.loaded / event.total);
      request.onerror = () => reject(new ConnectionError());
      request.onload = () => {
        const body = parseJson(request.responseText);
        if (request.status < 300) resolve(body);
        else reject(new ApiError(request.status, body, request.getResponseHeader('X-Request-Id')));
      };
      request.send(file);
    });
  }
}

export const treePath = (id) => `v1/trees/${id}`;

export const rayBody = ({ origin, direction }) =>
  JSON.stringify({ rays: [[...origin, ...direction]] });

/** "queue;dur=0.1, trace;dur=23" as {queue: 0.1, trace: 23}, in milliseconds. */
export function serverTiming(response) {
  const header = response.headers.get('Server-Timing') ?? '';
  const entries = header.split(',').map((entry) => entry.trim().split(';dur='));
  return Object.fromEntries(entries.map(([name, duration]) => [name, Number(duration)]));
}

async function errorOf(response) {
  const problem = parseJson(await response.text());
  return new ApiError(response.status, problem, response.headers.get('X-Request-Id'));
}

function parseJson(text) {
  try {
    return JSON.parse(text) ?? {};
  } catch {
    return {};
  }
}
