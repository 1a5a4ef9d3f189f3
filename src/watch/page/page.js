"use strict";
// Looks at the board of a running `curlsmoke watch`. Pixels come as the renderer has them, in linear light and single precision; how they
// are shown is decided here, by tables of the renderer's own view transforms.

const $ = (id) => document.getElementById(id);
const SIZE = 64, GAIN = 63, TOP = 10.5 * Math.LN2; // of those tables: see view_table.rs

// ---- False colour ------------------------------------------------------------------------------------------------------------

const STOPS = [-8, 6]; // from middle grey
const ramp = (stops) => {
  const bytes = new Uint8Array(256 * 4);
  for (let i = 0; i < 256; i++) {
    const t = i / 255;
    let n = 1;
    while (n < stops.length - 1 && stops[n][0] < t) n++;
    const [[a, from], [b, to]] = [stops[n - 1], stops[n]];
    const f = Math.min(1, Math.max(0, (t - a) / (b - a)));
    for (let c = 0; c < 3; c++) {
      const part = (hex) => parseInt(hex.slice(1 + 2 * c, 3 + 2 * c), 16);
      bytes[4 * i + c] = Math.round(part(from) + f * (part(to) - part(from)));
    }
    bytes[4 * i + 3] = 255;
  }
  return bytes;
};
// Middle grey is grey; what is darker is cold, what is brighter is warm, what clips is white.
const at = (stop) => (stop - STOPS[0]) / (STOPS[1] - STOPS[0]);
const LIGHT = ramp([[0, "#0b0614"], [at(-6), "#43208a"], [at(-4), "#2554c7"], [at(-2.5), "#1e97b8"], [at(-1), "#3aa866"],
  [at(-0.25), "#7a7a7a"], [at(0.25), "#868686"], [at(1), "#c9c043"], [at(2.3), "#e08a2b"], [at(4), "#d5362b"], [1, "#ffffff"]]);
const DATA = ramp([[0, "#440154"], [0.25, "#3b528b"], [0.5, "#21918c"], [0.75, "#5ec962"], [1, "#fde725"]]);

// ---- How pixels become colours of the screen ----------------------------------------------------------------------------------

// Ways to show: 0 through the view, 1 light in false colour, 2 the length of data between `range` in false colour, 3 directions.
const GLSL = `#version 300 es
precision highp float; precision highp sampler3D;
uniform sampler2D pixels, ramp; uniform sampler3D table;
uniform int way, channels; uniform float gain; uniform vec2 range; uniform vec2 size;
out vec4 color;
void main() {
  vec4 p = texelFetch(pixels, ivec2(int(gl_FragCoord.x), int(size.y) - 1 - int(gl_FragCoord.y)), 0);
  vec3 c = channels == 1 ? p.rrr : p.rgb;
  if (way == 0) {
    vec3 s = clamp(log(1.0 + ${GAIN}.0 * max(c * gain, 0.0)) / ${TOP}, 0.0, 1.0) * ${SIZE - 1}.0;
    ivec3 low = min(ivec3(s), ivec3(${SIZE - 2}));
    vec3 f = s - vec3(low);
    bool rg = f.r >= f.g, gb = f.g >= f.b, rb = f.r >= f.b;
    ivec3 most = rg && rb ? ivec3(1, 0, 0) : !rg && gb ? ivec3(0, 1, 0) : ivec3(0, 0, 1);
    ivec3 least = gb && rb ? ivec3(0, 0, 1) : rg && !gb ? ivec3(0, 1, 0) : ivec3(1, 0, 0);
    float a = dot(f, vec3(most)), z = dot(f, vec3(least)), m = f.r + f.g + f.b - a - z;
    color = (1.0 - a) * texelFetch(table, low, 0) + (a - m) * texelFetch(table, low + most, 0)
      + (m - z) * texelFetch(table, low + 1 - least, 0) + z * texelFetch(table, low + 1, 0);
  } else if (way == 3) {
    color = vec4(0.5 + 0.5 * c, 1.0);
  } else {
    float t;
    if (way == 1) t = (log2(max(dot(c * gain, vec3(0.2126, 0.7152, 0.0722)), 1e-9) / 0.18) - (${STOPS[0]}.0)) / ${STOPS[1] - STOPS[0]}.0;
    else t = ((channels == 1 ? p.r : length(channels == 2 ? vec3(p.rg, 0.0) : c)) - range.x) / max(range.y - range.x, 1e-20);
    bool none = way == 2 && !(abs(p.r) < 1e30);
    color = none ? vec4(0.08, 0.08, 0.08, 1.0) : texelFetch(ramp, ivec2(int(clamp(t, 0.0, 1.0) * 255.0 + 0.5), 0), 0);
  }
  color.a = 1.0;
}`;

/// Draws on a canvas as large as the picture, with WebGL 2.
function glDeveloper(canvas) {
  const gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
  if (!gl) return null;
  const program = gl.createProgram();
  const add = (kind, text) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  };
  add(gl.VERTEX_SHADER, `#version 300 es
void main() { gl_Position = vec4(vec2[3](vec2(-1), vec2(3, -1), vec2(-1, 3))[gl_VertexID], 0, 1); }`);
  add(gl.FRAGMENT_SHADER, GLSL);
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return null;
  gl.useProgram(program);
  const uniform = (name) => gl.getUniformLocation(program, name);
  ["pixels", "ramp", "table"].forEach((name, unit) => gl.uniform1i(uniform(name), unit));
  const texture = (unit, target, filter) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, gl.createTexture());
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, key, filter);
    for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) gl.texParameteri(target, key, gl.CLAMP_TO_EDGE);
  };
  texture(0, gl.TEXTURE_2D, gl.NEAREST);
  texture(1, gl.TEXTURE_2D, gl.NEAREST);
  texture(2, gl.TEXTURE_3D, gl.NEAREST);
  const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
  let shown = {};
  return {
    name: "WebGL 2",
    fits: (width, height) => width <= most && height <= most,
    draw({ width, height, count, data, serial, way, gain, range, table, ramp }) {
      if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
      gl.viewport(0, 0, width, height);
      if (shown.serial !== serial) {
        gl.activeTexture(gl.TEXTURE0);
        const [internal, format] = [[gl.R32F, gl.RED], [gl.RG32F, gl.RG], [gl.RGB32F, gl.RGB], [gl.RGBA32F, gl.RGBA]][count - 1];
        gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, height, 0, format, gl.FLOAT, data);
      }
      if (shown.ramp !== ramp) {
        gl.activeTexture(gl.TEXTURE1);
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, ramp);
      }
      if (table && shown.table !== table) {
        gl.activeTexture(gl.TEXTURE2);
        gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA16F, SIZE, SIZE, SIZE, 0, gl.RGBA, gl.HALF_FLOAT, table);
      }
      shown = { serial, ramp, table: table || shown.table };
      gl.uniform1i(uniform("way"), way);
      gl.uniform1i(uniform("channels"), count);
      gl.uniform1f(uniform("gain"), gain);
      gl.uniform2f(uniform("range"), range[0], range[1]);
      gl.uniform2f(uniform("size"), width, height);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    },
  };
}

const [RGB, RBG, BRG, GRB, GBR, BGR] = [[0, 1, 2], [0, 2, 1], [2, 0, 1], [1, 0, 2], [1, 2, 0], [2, 1, 0]];
const STEPS = [4, 4 * SIZE, 4 * SIZE * SIZE];

/// The same by the processor, where there is no WebGL.
function plainDeveloper(canvas) {
  const context = canvas.getContext("2d");
  const floats = new Map(); // tables as numbers
  const half = (h) => {
    const [e, m] = [h >> 10 & 31, h & 1023];
    return e === 0 ? m * 2 ** -24 : (1024 + m) * 2 ** (e - 25);
  };
  return {
    name: "2D",
    fits: () => true,
    draw({ width, height, count, data, way, gain, range, table, ramp }) {
      if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
      const image = context.createImageData(width, height);
      const out = image.data;
      if (table && !floats.has(table)) floats.set(table, Float32Array.from(table, half));
      const lut = table && floats.get(table);
      const scale = (SIZE - 1) / TOP;
      const low = [0, 0, 0], part = [0, 0, 0];
      for (let i = 0, n = width * height; i < n; i++) {
        const at = i * count;
        const r = data[at], g = count > 2 ? data[at + 1] : count === 2 ? 0 : r, b = count > 2 ? data[at + 2] : count === 2 ? 0 : r;
        const to = 4 * i;
        out[to + 3] = 255;
        if (way === 0) {
          for (let c = 0; c < 3; c++) {
            const x = Math.max(0, (c === 0 ? r : c === 1 ? g : b) * gain) || 0;
            const s = Math.min(SIZE - 1, Math.log(1 + GAIN * x) * scale);
            low[c] = Math.min(SIZE - 2, s | 0);
            part[c] = s - low[c];
          }
          // By tetrahedra: from the low corner along the axes, the largest part first.
          const [f, g1, h] = part;
          const axes = f >= g1 ? (g1 >= h ? RGB : f >= h ? RBG : BRG) : f >= h ? GRB : g1 >= h ? GBR : BGR;
          let place = 4 * ((low[2] * SIZE + low[1]) * SIZE + low[0]), left = 1;
          let [x, y, z] = [0, 0, 0];
          for (let step = 0; step < 4; step++) {
            const next = step < 3 ? part[axes[step]] : 0, weight = left - next;
            x += weight * lut[place]; y += weight * lut[place + 1]; z += weight * lut[place + 2];
            left = next;
            if (step < 3) place += STEPS[axes[step]];
          }
          out[to] = 255 * x; out[to + 1] = 255 * y; out[to + 2] = 255 * z; // rounded by the array itself
        } else if (way === 3) {
          [out[to], out[to + 1], out[to + 2]] = [r, g, b].map((x) => 127.5 + 127.5 * x);
        } else {
          const y = Math.max(gain * (0.2126 * r + 0.7152 * g + 0.0722 * b), 1e-9);
          const size = count === 1 ? r : count === 2 ? Math.hypot(r, data[at + 1]) : Math.hypot(r, g, b);
          const t = way === 1 ? (Math.log2(y / 0.18) - STOPS[0]) / (STOPS[1] - STOPS[0]) : (size - range[0]) / Math.max(range[1] - range[0], 1e-20);
          const from = 4 * Math.round(255 * Math.min(1, Math.max(0, t || 0)));
          const none = way === 2 && !Number.isFinite(r);
          for (let c = 0; c < 3; c++) out[to + c] = none ? 20 : ramp[from + c];
        }
      }
      context.putImageData(image, 0, 0);
    },
  };
}

// ---- What is known, and what is shown -----------------------------------------------------------------------------------------

let developed = document.createElement("canvas");
let developer = glDeveloper(developed);
if (!developer) {
  // A canvas that was asked for WebGL gives nothing else.
  developed = document.createElement("canvas");
  developer = plainDeveloper(developed);
}

let status = { version: 0, picture: 0, layers: [], views: [], problems: [] };
let pixels = null; // the layer that is shown: {layer, width, height, count, data, serial}
let serial = 0, layerName = "beauty", viewName = "", exposure = 0, isFalse = false;
const tables = new Map();
let zoom = 0, offset = [0, 0]; // zoom 0 fits
let cursor = null, pinned = null, drag = null;
const stage = $("stage"), sheet = stage.getContext("2d");

const layerOf = (name) => status.layers.findIndex((layer) => layer.name === name);
const wayOf = (layer) => {
  if (layer.is_color) return isFalse ? 1 : 0;
  if (layer.name === "N" && !isFalse) return 3;
  return layer.channels.length === 3 && !isFalse && layer.name !== "P" ? 0 : 2;
};

/// Between which numbers most data are: a horizon or a firefly is not what the colours are for.
function rangeOf({ count, data }) {
  const step = count * Math.max(1, Math.floor(data.length / count / 50000));
  const sizes = [];
  for (let i = 0; i < data.length; i += step) {
    const x = count > 1 ? Math.hypot(data[i], data[i + 1], count > 2 ? data[i + 2] : 0) : data[i];
    if (Number.isFinite(x)) sizes.push(x);
  }
  const sorted = Float32Array.from(sizes).sort();
  const share = (part) => sorted[Math.min(sorted.length - 1, Math.floor(part * sorted.length))] ?? 0;
  const [low, high] = [share(0.005), share(0.95)];
  return low < high ? [low, high] : [low, low + 1];
}

async function tableOf(name) {
  if (!tables.has(name)) {
    tables.set(name, fetch(`view?name=${name}`).then(async (answer) => new Uint16Array(await answer.arrayBuffer())));
  }
  return tables.get(name);
}

async function develop() {
  if (!pixels) return;
  const layer = pixels.layer;
  const way = wayOf(layer);
  const table = way === 0 ? await tableOf(viewName) : null;
  if (layer !== pixels.layer) return;
  const { width, height, count, data } = pixels;
  if (!developer.fits(width, height)) {
    developed = document.createElement("canvas");
    developer = plainDeveloper(developed);
  }
  const gain = way < 2 ? 2 ** exposure : 1;
  const range = way === 2 ? rangeOf(pixels) : [0, 1];
  developer.draw({ width, height, count, data, serial: pixels.serial, way, gain, range, table, ramp: way === 1 ? LIGHT : DATA });
  showLegend(way, range);
  paint();
}

function showLegend(way, range) {
  $("legend").hidden = way !== 1 && way !== 2;
  if ($("legend").hidden) return;
  const canvas = $("legend").querySelector("canvas");
  canvas.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(way === 1 ? LIGHT : DATA), 256, 1), 0, 0);
  const names = way === 1 ? ["−8", "−4.5", "grey", "", "+6 stops"] : [0, 0.5, 1].map((t) => short(range[0] + t * (range[1] - range[0])));
  $("legend").querySelector("div").replaceChildren(...names.map((name) => Object.assign(document.createElement("span"), { textContent: name })));
}

async function load() {
  const i = Math.max(0, layerOf(layerName));
  const layer = status.layers[i];
  if (!layer) return;
  const answer = await fetch(`pixels?layer=${i}`);
  if (!answer.ok) return;
  const [width, height, count] = answer.headers.get("X-Size").split(" ").map(Number);
  const data = new Float32Array(await answer.arrayBuffer());
  if (data.length !== width * height * count) return;
  const wasEmpty = !pixels || pixels.width !== width || pixels.height !== height;
  pixels = { layer, width, height, count, data, serial: ++serial };
  if (wasEmpty && zoom === 0) fit();
  await develop();
}

// Loads the newest as often as it comes, one at a time.
let isLoading = false, isStale = false;
async function refresh() {
  if (isLoading) { isStale = true; return; }
  isLoading = true;
  do { isStale = false; try { await load(); } catch { /* told by the loop below */ } } while (isStale);
  isLoading = false;
  inspect(true);
}

// ---- The stage ------------------------------------------------------------------------------------------------------------------

const ratio = () => window.devicePixelRatio || 1;
function placed() {
  const [width, height] = pixels ? [pixels.width, pixels.height] : [1, 1];
  const scale = zoom || Math.min(stage.width / width, stage.height / height) * 0.94;
  return { scale, x: stage.width / 2 + offset[0] - width * scale / 2, y: stage.height / 2 + offset[1] - height * scale / 2, width, height };
}
function fit() { zoom = 0; offset = [0, 0]; paint(); }
function toPixel(event) {
  const { scale, x, y, width, height } = placed();
  const box = stage.getBoundingClientRect();
  const px = Math.floor(((event.clientX - box.left) * ratio() - x) / scale), py = Math.floor(((event.clientY - box.top) * ratio() - y) / scale);
  return { x: px, y: py, inside: px >= 0 && py >= 0 && px < width && py < height };
}

function paint() {
  const box = stage.getBoundingClientRect();
  const [width, height] = [Math.round(box.width * ratio()), Math.round(box.height * ratio())];
  if (stage.width !== width || stage.height !== height) [stage.width, stage.height] = [width, height];
  sheet.clearRect(0, 0, width, height);
  if (!pixels) return;
  const p = placed();
  sheet.imageSmoothingEnabled = p.scale < 1;
  sheet.imageSmoothingQuality = "high";
  sheet.drawImage(developed, p.x, p.y, p.width * p.scale, p.height * p.scale);
  const frame = (edges, color) => {
    const [x0, y0, x1, y1] = edges;
    sheet.lineWidth = Math.max(1, ratio());
    sheet.strokeStyle = "rgba(0, 0, 0, .6)";
    sheet.strokeRect(p.x + x0 * p.scale - 1.5, p.y + y0 * p.scale - 1.5, (x1 - x0) * p.scale + 3, (y1 - y0) * p.scale + 3);
    sheet.strokeStyle = color;
    sheet.strokeRect(p.x + x0 * p.scale - .5, p.y + y0 * p.scale - .5, (x1 - x0) * p.scale + 1, (y1 - y0) * p.scale + 1);
  };
  if (status.crop) frame(status.crop, "#e0a63c");
  if (drag && drag.crop) frame(drag.crop, "#ffffff");
  if (pinned) frame([pinned.x, pinned.y, pinned.x + 1, pinned.y + 1], "#ffffff");
  $("zoom").textContent = `${p.width} × ${p.height}  ·  ${Math.round(100 * p.scale)} %`;
}

let isMoving = false;
stage.addEventListener("pointerdown", (event) => {
  stage.setPointerCapture(event.pointerId);
  stage.focus();
  const moves = event.button !== 0 || isMoving;
  drag = { moves, start: [event.clientX, event.clientY], offset: [...offset], from: toPixel(event), crop: null };
  stage.classList.toggle("moving", moves);
});
stage.addEventListener("pointermove", (event) => {
  cursor = toPixel(event);
  if (drag) {
    const by = [event.clientX - drag.start[0], event.clientY - drag.start[1]];
    if (drag.moves) {
      if (zoom === 0) zoom = placed().scale;
      offset = [drag.offset[0] + by[0] * ratio(), drag.offset[1] + by[1] * ratio()];
    } else if (pixels && Math.hypot(...by) > 4) {
      const inside = (x, most) => Math.min(Math.max(x, 0), most - 1);
      const xs = [drag.from.x, cursor.x].map((x) => inside(x, pixels.width)).sort((a, b) => a - b);
      const ys = [drag.from.y, cursor.y].map((y) => inside(y, pixels.height)).sort((a, b) => a - b);
      drag.crop = [xs[0], ys[0], xs[1] + 1, ys[1] + 1];
    }
    paint();
  }
  inspect(false);
});
stage.addEventListener("pointerup", () => {
  const ended = drag;
  drag = null;
  stage.classList.remove("moving");
  if (ended && !ended.moves && ended.crop) {
    const [x0, y0, x1, y1] = ended.crop;
    post(`crop?x0=${x0}&y0=${y0}&x1=${x1}&y1=${y1}`);
  } else if (ended && !ended.moves && cursor && cursor.inside) {
    pinned = pinned && pinned.x === cursor.x && pinned.y === cursor.y ? null : cursor;
    inspect(true);
  }
  paint();
});
stage.addEventListener("pointerleave", () => { if (!drag) { cursor = null; inspect(false); } });
stage.addEventListener("contextmenu", (event) => event.preventDefault());
stage.addEventListener("wheel", (event) => {
  event.preventDefault();
  const before = placed();
  const box = stage.getBoundingClientRect();
  const at = [(event.clientX - box.left) * ratio() - stage.width / 2, (event.clientY - box.top) * ratio() - stage.height / 2];
  zoom = Math.min(64, Math.max(0.02, before.scale * 2 ** (-event.deltaY / 240)));
  // What is under the pointer stays there.
  offset = offset.map((o, i) => at[i] - (at[i] - o) * zoom / before.scale);
  paint();
}, { passive: false });
new ResizeObserver(paint).observe(stage);

// ---- The inspector --------------------------------------------------------------------------------------------------------------

function short(x) {
  if (typeof x === "string") x = x === "inf" ? Infinity : x === "-inf" ? -Infinity : Number(x);
  if (Number.isNaN(x)) return "NaN";
  if (!Number.isFinite(x)) return x > 0 ? "∞" : "−∞";
  const size = Math.abs(x);
  const text = x !== 0 && (size < 1e-3 || size >= 1e5) ? x.toExponential(3) : Number.isInteger(x) && size >= 10 ? String(x) : x.toPrecision(5).slice(0, x < 0 ? 8 : 7);
  return text.replace("-", "−");
}

let asked = "";
async function inspect(isNew) {
  const place = pinned || (cursor && cursor.inside ? cursor : null);
  const key = place ? `${place.x},${place.y},${status.picture}` : "";
  if (key === asked && !isNew) return;
  asked = key;
  $("place").textContent = place ? `${place.x}, ${place.y}${pinned ? "  pinned" : ""}` : "";
  const body = $("inspector").querySelector("tbody");
  if (!place) { body.replaceChildren(); return; }
  let channels;
  try { channels = (await (await fetch(`pixel?x=${place.x}&y=${place.y}`)).json()).channels; } catch { return; }
  if (key !== asked) return;
  const rows = status.layers.flatMap((layer) => layer.channels.map((name, i) => {
    const row = document.createElement("tr");
    row.className = `${i === 0 ? "head" : ""} ${layer.name === layerName ? "chosen" : ""}`;
    for (const text of [name, name in channels ? short(channels[name]) : ""]) row.append(Object.assign(document.createElement("td"), { textContent: text }));
    row.title = `${name}  ${channels[name]}`;
    return row;
  }));
  body.replaceChildren(...rows);
}

// ---- What people choose -----------------------------------------------------------------------------------------------------------

const post = (what) => fetch(what, { method: "POST" }).catch(() => {});
function chooseLayer(name) { layerName = name; showChoices(); refresh(); }
function chooseView(name) { viewName = name; showChoices(); develop(); }
function expose(ev) {
  exposure = Math.min(20, Math.max(-20, Math.round(10 * ev) / 10));
  $("exposure").value = exposure;
  $("ev").textContent = `${exposure < 0 ? "−" : "+"}${Math.abs(exposure).toFixed(1)}`;
  develop();
}
function setFalse(is) { isFalse = is; $("false-color").checked = is; develop(); }

function showChoices() {
  const option = (name, role, state, chosen, choose) => {
    const button = Object.assign(document.createElement("button"), { textContent: name, title: name });
    button.setAttribute("role", role);
    button.setAttribute(state, String(chosen));
    button.addEventListener("click", () => choose(name));
    return button;
  };
  $("layers").replaceChildren(...status.layers.map((layer) => option(layer.name, "option", "aria-selected", layer.name === layerName, chooseLayer)));
  $("views").replaceChildren(...status.views.map((name) => option(name, "radio", "aria-checked", name === viewName, chooseView)));
}

$("exposure").addEventListener("input", (event) => expose(Number(event.target.value)));
$("exposure").addEventListener("dblclick", () => expose(status.exposure_ev));
$("false-color").addEventListener("change", (event) => setFalse(event.target.checked));
$("uncrop").addEventListener("click", () => post("crop"));
$("help-button").addEventListener("click", () => { $("help").hidden = !$("help").hidden; });

let frameTimer = 0;
function chooseFrame(frame) {
  frame = Math.min(status.last, Math.max(status.first, frame));
  $("timeline").value = frame;
  $("frame").textContent = frame;
  clearTimeout(frameTimer);
  // A hand on the slider passes many frames on its way.
  frameTimer = setTimeout(() => post(`frame?number=${frame}`), 120);
}
$("timeline").addEventListener("input", (event) => chooseFrame(Number(event.target.value)));
$("before").addEventListener("click", () => chooseFrame(Number($("timeline").value) - 1));
$("next").addEventListener("click", () => chooseFrame(Number($("timeline").value) + 1));

const next = (list, item, by) => list[(list.indexOf(item) + by + list.length) % list.length];
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const by = event.shiftKey ? -1 : 1;
  const isSlider = event.target instanceof HTMLInputElement && event.target.type === "range";
  const keys = {
    l: () => chooseLayer(next(status.layers.map((layer) => layer.name), layerName, by)),
    e: () => expose(exposure + 0.5 * by),
    0: () => expose(status.exposure_ev),
    v: () => chooseView(next(status.views, viewName, by)),
    c: () => setFalse(!isFalse),
    f: fit,
    1: () => { zoom = 1; offset = [0, 0]; paint(); },
    x: () => post("crop"),
    "?": () => { $("help").hidden = !$("help").hidden; },
    escape: () => { $("help").hidden = true; pinned = null; drag = null; inspect(true); paint(); },
    " ": () => { isMoving = true; },
    arrowleft: isSlider ? null : () => chooseFrame(Number($("timeline").value) - 1),
    arrowright: isSlider ? null : () => chooseFrame(Number($("timeline").value) + 1),
  };
  const act = keys[event.key.toLowerCase()];
  if (!act || (event.key === " " && event.target instanceof HTMLButtonElement)) return;
  event.preventDefault();
  act();
});
addEventListener("keyup", (event) => { if (event.key === " ") isMoving = false; });

// ---- The board ----------------------------------------------------------------------------------------------------------------------

function showProblems() {
  $("problems").hidden = status.problems.length === 0;
  const element = (tag, className, text) => Object.assign(document.createElement(tag), { className, textContent: text });
  $("problems").replaceChildren(...status.problems.map((problem) => {
    const article = element("article", problem.severity, "");
    const place = [problem.file, problem.line, problem.column].filter((part) => part !== null && part !== "").join(":");
    article.append(element("div", "where", [problem.severity, place, problem.key].filter(Boolean).join("  ")));
    article.append(element("p", "", problem.message));
    if (problem.excerpt.trim()) {
      const [caret, length] = problem.caret;
      const number = String(problem.line ?? "");
      const pre = element("pre", "", "");
      const most = Math.max(1, Math.min(length, [...problem.excerpt].length - caret));
      pre.append(element("i", "", `${number}  `), `${problem.excerpt}\n`, " ".repeat(number.length + 2 + caret), element("b", "", "^".repeat(most)));
      article.append(pre);
    }
    for (const way of problem.help) article.append(element("div", "way", way));
    return article;
  }));
}

function show(last) {
  document.title = status.scene ? `${status.scene} · curlsmoke` : "curlsmoke";
  $("scene").textContent = status.scene || "curlsmoke";
  const names = { reading: "reading", geometry: "shapes", advect: "particles", grid: "density", render: "rendering", done: "done", error: "error" };
  $("activity").textContent = names[status.activity] || status.activity;
  $("activity").className = `chip ${status.activity}`;
  $("paths").textContent = status.picture ? `${status.paths || "<1"} / ${status.spp} paths` : "";
  const made = status.made.length ? `made: ${status.made.join(", ")}` : "all kept";
  $("timing").textContent = status.picture ? `first pixels ${status.first_pixels.toFixed(2)} s · ${made}` : "";
  $("timing").title = $("timing").textContent;
  $("bar").className = status.activity === "done" || status.activity === "error" ? "idle" : "";
  $("bar").firstElementChild.style.width = `${100 * status.fraction}%`;
  if (document.activeElement !== $("timeline") || last.frame !== status.frame) {
    [$("timeline").min, $("timeline").max, $("timeline").value] = [status.first, status.last, status.frame];
    $("frame").textContent = status.frame;
  }
  [$("first").textContent, $("last").textContent] = [status.first, status.last];
  $("crop").hidden = !status.crop;
  $("edges").textContent = status.crop ? status.crop.join(", ") : "";
  if (JSON.stringify(last.problems) !== JSON.stringify(status.problems)) showProblems();
  // The scene's own choice holds until another is made, and again when it changes.
  const isNewView = status.view && last.view !== status.view, isNewExposure = status.view && last.exposure_ev !== status.exposure_ev;
  if (isNewView) viewName = status.view;
  if (isNewExposure) expose(status.exposure_ev);
  if (isNewView || JSON.stringify(last.layers) !== JSON.stringify(status.layers)) {
    if (layerOf(layerName) < 0) layerName = "beauty";
    showChoices();
  }
  if (last.picture !== status.picture && status.layers.length) refresh();
  else if (JSON.stringify(last.crop) !== JSON.stringify(status.crop)) paint();
}

async function watch() {
  for (;;) {
    try {
      const answer = await fetch(`status?after=${status.version}`);
      const last = status;
      status = await answer.json();
      show(last);
    } catch {
      $("activity").textContent = "not connected";
      $("activity").className = "chip error";
      // The program may be started anew, and count from 1 again.
      status = { ...status, version: 0, picture: -1 };
      await new Promise((done) => setTimeout(done, 1000));
    }
  }
}
showChoices();
watch();
