// Images by name: from blocks of the page, or from files next to it, unpacked at first use.

const MOST_BYTES = 400e6; // of unpacked images; the least recently shown ones are dropped first
const WAITING = new Map(); // callbacks that wait, by the name of a file that is being loaded

// An image file is a script that calls this: a page opened from disk may load nothing else.
globalThis.glossbenchImage = (name, base64) => WAITING.get(name)?.(base64);

class Store {
  constructor(folder) {
    this.folder = folder;
    this.images = new Map(); // by name, least recently used first: {name, width, height, half} or {problem}
    this.loading = new Map();
  }

  // The image if it is loaded; else null, and `then` is called when it is loaded.
  get(name, width, height, then) {
    const image = this.images.get(name);
    if (image) {
      this.images.delete(name);
      this.images.set(name, image);
      return image;
    }
    if (!this.loading.has(name)) this.loading.set(name, this.load(name, width, height));
    this.loading.get(name).then(then);
    return null;
  }

  async load(name, width, height) {
    let image;
    try {
      const block = document.getElementById(`image-${name}`);
      const base64 = block ? block.textContent : await this.file(name);
      const half = unpacked(await inflated(bytesOf(base64)), width, height);
      image = { name, width, height, half };
    } catch (error) {
      image = { name, width, height, problem: error.message };
    }
    this.images.set(name, image);
    this.loading.delete(name);
    let held = 0;
    for (const each of this.images.values()) held += each.half?.byteLength ?? 0;
    for (const [old, each] of this.images) {
      if (held <= MOST_BYTES || old === name) break;
      held -= each.half?.byteLength ?? 0;
      this.images.delete(old);
    }
    return image;
  }

  file(name) {
    return new Promise((resolve, reject) => {
      const script = document.createElement('script');
      const path = `${this.folder}/${name}.js`;
      WAITING.set(name, resolve);
      script.src = path;
      script.onerror = () => reject(new Error(`${path} is missing: keep that folder next to this page`));
      script.onload = () => reject(new Error(`${path} is damaged`)); // has no effect if the script has called
      document.head.append(script);
    }).finally(() => {
      WAITING.delete(name);
    });
  }
}
