// Shows the scene of this page with PlayCanvas's viewer, and names the instance under the pointer.
// A pixel's instance is found from the splats themselves: each splat's highest opacity along the pixel's ray is
// blended from front to back, and the instance that adds the most to the pixel is the one.

const MOST_SIGMAS = 3;
const LEAST_OPACITY = 0.1; // of a whole pixel; below it there is nothing to name
const DRAG_PIXELS = 5;

const get = (id) => document.getElementById(id);

const decode = async (id) => {
  const text = get(id).textContent;
  get(id).remove();
  return (await fetch(`data:application/octet-stream;base64,${text}`)).blob();
};

const unpack = (blob, format) => new Response(blob.stream().pipeThrough(new DecompressionStream(format)));

// Members of a zip archive that stores them uncompressed.
const listMembers = (buffer) => {
  const view = new DataView(buffer);
  const names = new TextDecoder();
  const members = new Map();
  let end = buffer.byteLength - 22;
  while (view.getUint32(end, true) !== 0x06054b50) end -= 1;
  let place = view.getUint32(end + 16, true);
  for (let left = view.getUint16(end + 10, true); left > 0; left -= 1) {
    const size = view.getUint32(place + 24, true);
    const nameSize = view.getUint16(place + 28, true);
    const local = view.getUint32(place + 42, true);
    const start = local + 30 + view.getUint16(local + 26, true) + view.getUint16(local + 28, true);
    members.set(names.decode(new Uint8Array(buffer, place + 46, nameSize)), new Uint8Array(buffer, start, size));
    place += 46 + nameSize + view.getUint16(place + 30, true) + view.getUint16(place + 32, true);
  }
  return members;
};

const readPixels = async (data) => {
  const options = { colorSpaceConversion: 'none', premultiplyAlpha: 'none' };
  const image = await createImageBitmap(new Blob([data], { type: 'image/webp' }), options);
  const canvas = new OffscreenCanvas(image.width, image.height);
  const context = canvas.getContext('2d', { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, image.width, image.height).data;
};

// What picking needs of each splat, in the axes of the file.
const readSplats = async (buffer) => {
  const members = listMembers(buffer);
  const meta = JSON.parse(new TextDecoder().decode(members.get('meta.json')));
  const names = ['means_l', 'means_u', 'scales', 'quats', 'sh0'];
  const [low, high, scales, quats, colors] = await Promise.all(
    names.map((name) => readPixels(members.get(`${name}.webp`))));
  const means = new Float32Array(3 * meta.count);
  for (let splat = 0; splat < meta.count; splat += 1) {
    for (let axis = 0; axis < 3; axis += 1) {
      const step = low[4 * splat + axis] + 256 * high[4 * splat + axis];
      const { mins, maxs } = meta.means;
      const value = mins[axis] + (maxs[axis] - mins[axis]) * step / 65535;
      means[3 * splat + axis] = Math.sign(value) * Math.expm1(Math.abs(value));
    }
  }
  const sizes = Float32Array.from(meta.scales.codebook, Math.exp);
  return { count: meta.count, means, scales, quats, colors, sizes };
};

const rotationOf = (quats, splat) => {
  const largest = quats[4 * splat + 3] - 252;
  const q = [0, 0, 0, 0];
  let sum = 0;
  let column = 0;
  for (let part = 0; part < 4; part += 1) {
    if (part === largest) continue;
    q[part] = (quats[4 * splat + column] / 255 * 2 - 1) * Math.SQRT1_2;
    sum += q[part] * q[part];
    column += 1;
  }
  q[largest] = Math.sqrt(Math.max(0, 1 - sum));
  const [w, x, y, z] = q;
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)];
};

// Opacity of a splat along a ray: where the ray passes nearest to it, in its own standard deviations.
const opacityOf = (splats, splat, origin, ray, blur) => {
  const turn = rotationOf(splats.quats, splat);
  const from = [0, 0, 0];
  const along = [0, 0, 0];
  for (let axis = 0; axis < 3; axis += 1) {
    const size = Math.hypot(splats.sizes[splats.scales[4 * splat + axis]], blur);
    for (let row = 0; row < 3; row += 1) {
      from[axis] += turn[3 * row + axis] * (origin[row] - splats.means[3 * splat + row]) / size;
      along[axis] += turn[3 * row + axis] * ray[row] / size;
    }
  }
  const length = along[0] ** 2 + along[1] ** 2 + along[2] ** 2;
  const nearest = (from[0] * along[0] + from[1] * along[1] + from[2] * along[2]) ** 2 / length;
  const distance = from[0] ** 2 + from[1] ** 2 + from[2] ** 2 - nearest;
  return Math.exp(-0.5 * Math.max(0, distance)) * splats.colors[4 * splat + 3] / 255;
};

const pick = (splats, ids, origin, ray, pixel) => {
  const { means, scales, sizes } = splats;
  const hits = [];
  for (let splat = 0; splat < splats.count; splat += 1) {
    const x = means[3 * splat] - origin[0];
    const y = means[3 * splat + 1] - origin[1];
    const z = means[3 * splat + 2] - origin[2];
    const depth = x * ray[0] + y * ray[1] + z * ray[2];
    if (depth <= 0.1) continue;
    const blur = 0.5 * pixel * depth;
    const apart = x * x + y * y + z * z - depth * depth;
    const size = Math.max(sizes[scales[4 * splat]], sizes[scales[4 * splat + 1]], sizes[scales[4 * splat + 2]]);
    const reach = MOST_SIGMAS * (size + blur);
    if (apart < reach * reach) hits.push([depth, splat, blur]);
  }
  hits.sort((a, b) => a[0] - b[0]);
  const shares = new Map();
  let left = 1;
  for (const [, splat, blur] of hits) {
    const share = left * opacityOf(splats, splat, origin, ray, blur);
    shares.set(ids[splat], (shares.get(ids[splat]) ?? 0) + share);
    left -= share;
    if (left < 0.01) break;
  }
  let best = 0;
  if (1 - left > LEAST_OPACITY) for (const [id, share] of shares) if (share > (shares.get(best) ?? 0)) best = id;
  return best;
};

const show = (element, id, instances) => {
  const entry = instances[id];
  element.hidden = !id;
  element.dataset.id = id;
  if (!id) return;
  element.textContent = entry?.name || `instance ${id}`;
  const below = document.createElement('small');
  below.textContent = entry?.class ? `${entry.class}, ID ${id}` : `ID ${id}`;
  element.append(below);
  element.style.borderColor = `rgb(${(entry?.color ?? [136, 136, 136]).join(',')})`;
};

const nameInstances = (viewer, splats, ids, instances) => {
  const canvas = get('instdrive-scene').querySelector('canvas');
  const camera = viewer.app.root.findComponents('camera').find((found) => found.enabled);
  const find = (event) => {
    const box = canvas.getBoundingClientRect();
    const at = (x, y) => {
      const point = camera.screenToWorld(x - box.left, y - box.top, 1);
      return [-point.x, -point.y, point.z]; // the viewer turns the file by 180 degrees about z
    };
    const position = camera.entity.getPosition();
    const origin = [-position.x, -position.y, position.z];
    const towards = at(event.clientX, event.clientY).map((value, axis) => value - origin[axis]);
    const beside = at(event.clientX + 1, event.clientY).map((value, axis) => value - origin[axis]);
    const length = Math.hypot(...towards);
    const pixel = Math.hypot(...beside.map((value, axis) => value - towards[axis])) / length;
    return pick(splats, ids, origin, towards.map((value) => value / length), pixel);
  };
  const hover = get('instdrive-hover');
  const picked = get('instdrive-picked');
  let pressed = null;
  let moved = null;
  const follow = () => {
    const event = moved;
    moved = null;
    show(hover, find(event), instances);
    hover.style.left = `${Math.min(event.clientX + 16, innerWidth - hover.offsetWidth - 4)}px`;
    hover.style.top = `${Math.min(event.clientY + 16, innerHeight - hover.offsetHeight - 4)}px`;
  };
  addEventListener('pointermove', (event) => {
    if (event.buttons || event.target !== canvas) {
      hover.hidden = true;
      return;
    }
    if (!moved) setTimeout(follow, 50);
    moved = event;
  }, true);
  addEventListener('pointerdown', (event) => {
    pressed = event.target === canvas && event.button === 0 ? event : null;
  }, true);
  addEventListener('pointerup', (event) => {
    const far = pressed && Math.hypot(event.clientX - pressed.clientX, event.clientY - pressed.clientY);
    if (pressed && far < DRAG_PIXELS) show(picked, find(event), instances);
    pressed = null;
  }, true);
};

const open = async () => {
  document.title = decodeURIComponent(location.pathname.split('/').pop()).replace(/\.html$/, '') || document.title;
  const about = JSON.parse(get('instdrive-about').textContent);
  const [content, packedIds, packedViewer] = await Promise.all(
    ['instdrive-splats', 'instdrive-ids', 'instdrive-viewer'].map(decode));
  const script = await unpack(packedViewer, 'gzip').text();
  const ids = new Uint32Array(await unpack(packedIds, 'deflate').arrayBuffer());
  const url = URL.createObjectURL(new Blob([script], { type: 'text/javascript' }));
  const { createViewer } = await import(url);
  const viewer = await createViewer({
    container: get('instdrive-scene'),
    settings: about.settings,
    contentUrl: URL.createObjectURL(content),
    contentFilename: 'scene.sog',
    contents: Promise.resolve(new Response(content)),
    noanim: true,
    renderer: 'webgl', // draws the same everywhere; WebGPU is not on every computer
  });
  nameInstances(viewer, await readSplats(await content.arrayBuffer()), ids, about.instances);
  const finish = () => {
    viewer.state.cameraMode = 'orbit'; // a click flies to what it hits in the other modes
    document.body.dataset.loaded = 'yes';
  };
  if (viewer.state.loaded) finish();
  else viewer.events.once('loaded:changed', finish);
};

open().catch((error) => {
  get('instdrive-problem').textContent = `This scene cannot be shown: ${error.message}`;
  get('instdrive-problem').hidden = false;
});
