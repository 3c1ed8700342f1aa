// Zoom and read-out of the figures. Without it the figures are whole, only still.
(() => {
  "use strict";
  const NS = "http://www.w3.org/2000/svg";
  const COLUMNS = 900; // stretches of a redrawn curve: one for each pixel of a wide screen
  const STEP = 0.6; // a press of + leaves this share of the abscissa

  const make = (tag, attributes) => {
    const element = document.createElementNS(NS, tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    return element;
  };

  const numbers = (packed) => {
    if (packed.step !== undefined) {
      return Float64Array.from({ length: packed.n }, (_, i) => packed.start + i * packed.step);
    }
    const bytes = Uint8Array.from(atob(packed.data), (c) => c.charCodeAt(0));
    return packed.bytes === 8 ? new Float64Array(bytes.buffer) : new Float32Array(bytes.buffer);
  };

  // first place in a rising array whose value is not below x
  const place = (xs, x) => {
    let low = 0;
    let high = xs.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (xs[middle] < x) low = middle + 1;
      else high = middle;
    }
    return low;
  };

  const scale = (log) => (log ? Math.log10 : (v) => v);
  const back = (log) => (log ? (v) => 10 ** v : (v) => v);

  // round numbers between two ends, at most `most` of them
  const ticks = (low, high, most) => {
    const rough = (high - low) / most;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= rough);
    const found = [];
    for (let k = Math.ceil(low / step); k * step <= high * (1 + 1e-12); k += 1) found.push(k * step);
    return [found, Math.max(0, Math.ceil(-Math.log10(step) - 1e-9))];
  };

  const short = (value, span) => {
    if (!Number.isFinite(value)) return "–";
    const places = Math.min(9, Math.max(0, Math.ceil(3 - Math.log10(span || 1))));
    return Math.abs(value) >= 1e5 || (value !== 0 && Math.abs(value) < 1e-4)
      ? value.toExponential(3)
      : value.toFixed(places);
  };

  class Axes {
    constructor(figure, spec) {
      Object.assign(this, spec);
      this.figure = figure;
      this.fx = scale(spec.logx);
      this.fy = scale(spec.logy);
      this.whole = { x: spec.x, y: spec.y };
      this.now = this.whole;
      for (const line of this.lines) {
        line.element = figure.part(line.id);
        line.values = [numbers(line.xs), numbers(line.ys)];
        const path = line.element && line.element.querySelector("path[style*=stroke]");
        line.path = line.line ? path : null;
        line.drawn = path ? path.getAttribute("d") : "";
        line.colour = path ? path.style.stroke : "currentColor";
      }
      this.movers = this.moved.map((id) => figure.part(id)).filter(Boolean);
      this.words = this.texts.map((t) => ({ ...t, element: figure.part(t.id) })).filter((t) => t.element);
      this.layer = make("g", { class: "zoomed" });
      const [x, y, width, height] = this.box;
      const clip = make("clipPath", { id: `${figure.name}-clip-${this.at}` });
      clip.append(make("rect", { x, y, width, height }));
      this.inside = make("g", { "clip-path": `url(#${clip.id})` });
      this.layer.append(clip, this.inside);
      this.guide = make("line", { class: "guide", y1: y, y2: y + height, visibility: "hidden" });
      this.brush = make("rect", { class: "brush", y, height, width: 0, visibility: "hidden" });
      figure.svg.append(this.layer, this.guide, this.brush);
    }

    px(value) {
      const [low, high] = this.now.x.map(this.fx);
      return this.box[0] + ((this.fx(value) - low) / (high - low)) * this.box[2];
    }

    py(value) {
      const [low, high] = this.now.y.map(this.fy);
      return this.box[1] + this.box[3] - ((this.fy(value) - low) / (high - low)) * this.box[3];
    }

    value(px) {
      const [low, high] = this.now.x.map(this.fx);
      return back(this.logx)(low + ((px - this.box[0]) / this.box[2]) * (high - low));
    }

    // lowest and highest value of what is seen, with a margin
    fitted(x) {
      let low = Infinity;
      let high = -Infinity;
      for (const line of this.lines) {
        const [xs, ys] = line.values;
        const [first, end] = line.rising ? [place(xs, x[0]), place(xs, x[1])] : [0, xs.length];
        for (let i = first; i < end; i += 1) {
          if (!(xs[i] >= x[0] && xs[i] <= x[1]) || !Number.isFinite(ys[i])) continue;
          if (this.logy && !(ys[i] > 0)) continue;
          if (ys[i] < low) low = ys[i];
          if (ys[i] > high) high = ys[i];
        }
      }
      if (!(high > low)) return this.whole.y;
      const [from, to] = [this.fy(low), this.fy(high)];
      const margin = 0.05 * (to - from);
      return [from - margin, to + margin].map(back(this.logy));
    }

    set(x) {
      const same = x[0] <= this.whole.x[0] && x[1] >= this.whole.x[1];
      this.now = same ? this.whole : { x, y: this.fitted(x) };
      this.figure.svg.classList.toggle("is-zoomed", !same);
      if (same) this.restore();
      else this.draw();
    }

    restore() {
      this.inside.replaceChildren();
      this.layer.querySelectorAll(".tick").forEach((tick) => tick.remove());
      for (const line of this.lines) if (line.element) line.element.style.display = "";
      for (const mover of this.movers) mover.style.display = "";
      for (const word of this.words) {
        word.element.style.display = "";
        word.element.removeAttribute("transform");
      }
      this.figure.axis(this.at, true);
    }

    draw() {
      this.restore();
      this.figure.axis(this.at, false);
      this.drawTicks();
      for (const line of this.lines) {
        if (line.element) line.element.style.display = "none";
        if (line.path) {
          const path = line.path.cloneNode(false);
          path.removeAttribute("clip-path");
          path.setAttribute("d", this.curve(line));
          this.inside.append(path);
        }
        if (line.marker) this.dots(line);
      }
      for (const mover of this.movers) {
        const copy = mover.cloneNode(true);
        copy.removeAttribute("id");
        copy.querySelectorAll("[clip-path]").forEach((e) => e.removeAttribute("clip-path"));
        copy.setAttribute("transform", this.matrix());
        copy.classList.add("moved");
        mover.style.display = "none";
        this.inside.append(copy);
      }
      for (const word of this.words) this.moveWord(word);
    }

    // takes the whole picture to the part that is seen
    matrix() {
      const [x0, x1] = this.whole.x.map((v) => this.px(v));
      const [y0, y1] = this.whole.y.map((v) => this.py(v));
      const [left, top, width, height] = this.box;
      const sx = (x1 - x0) / width;
      const sy = (y0 - y1) / height;
      return `matrix(${sx} 0 0 ${sy} ${x0 - sx * left} ${y1 - sy * top})`;
    }

    moveWord(word) {
      const now = [this.px(word.x), this.py(word.y)];
      const then = this.now;
      this.now = this.whole;
      const was = [this.px(word.x), this.py(word.y)];
      this.now = then;
      const [left, top, width, height] = this.box;
      const seen = now[0] >= left && now[0] <= left + width && now[1] >= top && now[1] <= top + height;
      word.element.style.display = seen ? "" : "none";
      word.element.setAttribute("transform", `translate(${now[0] - was[0]} ${now[1] - was[1]})`);
    }

    // smallest and largest value of each stretch, as in the still picture
    curve(line) {
      const [xs, ys] = line.values;
      let [first, end] = [0, xs.length];
      if (line.rising) {
        first = Math.max(0, place(xs, this.now.x[0]) - 1);
        end = Math.min(xs.length, place(xs, this.now.x[1]) + 2);
      }
      const parts = [];
      let pen = false;
      const put = (i) => {
        const good = Number.isFinite(ys[i]) && Number.isFinite(xs[i]) && !(this.logy && !(ys[i] > 0));
        if (good) parts.push(`${pen ? "L" : "M"}${this.px(xs[i]).toFixed(2)} ${this.py(ys[i]).toFixed(2)}`);
        pen = good;
      };
      const width = (end - first) / COLUMNS;
      if (!line.rising || width <= 2) {
        for (let i = first; i < end; i += 1) put(i);
        return parts.join("");
      }
      for (let column = 0; column < COLUMNS; column += 1) {
        const from = first + Math.floor(column * width);
        const to = first + Math.floor((column + 1) * width);
        let [low, high, gap] = [-1, -1, false];
        for (let i = from; i < to; i += 1) {
          if (!Number.isFinite(ys[i])) gap = true;
          else {
            if (low < 0 || ys[i] < ys[low]) low = i;
            if (high < 0 || ys[i] > ys[high]) high = i;
          }
        }
        if (low >= 0) {
          put(Math.min(low, high));
          if (low !== high) put(Math.max(low, high));
        }
        if (gap) pen = false;
      }
      return parts.join("");
    }

    dots(line) {
      const [xs, ys] = line.values;
      const use = line.element && line.element.querySelector("use");
      const colour = (use && use.style.stroke) || line.colour;
      for (let i = 0; i < xs.length; i += 1) {
        if (!(xs[i] >= this.now.x[0] && xs[i] <= this.now.x[1]) || !Number.isFinite(ys[i])) continue;
        const dot = make("circle", { cx: this.px(xs[i]), cy: this.py(ys[i]), r: 2.4 });
        dot.style.stroke = colour;
        dot.style.fill = line.open ? "none" : (use && use.style.fill) || colour;
        this.inside.append(dot);
      }
    }

    drawTicks() {
      const [left, top, width, height] = this.box;
      const add = (x, y, anchor, text, grid) => {
        const mark = make("g", { class: "tick" });
        mark.append(make("line", grid));
        const label = make("text", { x, y, "text-anchor": anchor });
        label.textContent = text;
        mark.append(label);
        this.layer.prepend(mark);
      };
      const labels = ([low, high], log, most) => {
        if (!log) {
          const [found, places] = ticks(low, high, most);
          return found.map((v) => [v, v.toFixed(places).replace(/^-(0(\.0*)?)$/, "$1")]);
        }
        const [found] = ticks(Math.log10(low), Math.log10(high), most);
        return found.map((e) => [10 ** e, (10 ** e).toPrecision(3)]);
      };
      for (const [v, text] of labels(this.now.x, this.logx, 6)) {
        const x = this.px(v);
        add(x, top + height + 12, "middle", text, { x1: x, x2: x, y1: top, y2: top + height });
      }
      for (const [v, text] of labels(this.now.y, this.logy, 5)) {
        const y = this.py(v);
        add(left - 4, y + 3, "end", text, { y1: y, y2: y, x1: left, x2: left + width });
      }
    }

    // what the curves are at an abscissa
    read(x) {
      const span = this.now.x[1] - this.now.x[0];
      const height = this.now.y[1] - this.now.y[0];
      const words = [];
      for (const line of this.lines) {
        if (!line.rising) continue;
        const [xs, ys] = line.values;
        let i = place(xs, x);
        if (i > 0 && (i === xs.length || x - xs[i - 1] < xs[i] - x)) i -= 1;
        if (i < xs.length) words.push(`${line.label || this.ylabel} ${short(ys[i], height)}`);
      }
      return words.length ? `${this.xlabel || "x"} ${short(x, span)}: ${words.join(", ")}` : "";
    }
  }

  class Figure {
    constructor(svg, spec) {
      this.svg = svg;
      this.name = spec.name;
      this.box = svg.closest("figure");
      this.axes = spec.axes.map((one) => new Axes(this, one));
      this.active = this.axes[0];
      this.tools();
      this.listen();
    }

    part(id) {
      return document.getElementById(`${this.name}-${id}`);
    }

    // ticks and grid as they were drawn first
    axis(at, shown) {
      const group = document.getElementById(`${this.name}-axes_${at + 1}`);
      if (!group) return;
      for (const part of group.querySelectorAll('[id*="xtick_"], [id*="ytick_"]')) {
        part.style.display = shown ? "" : "none";
      }
    }

    tools() {
      const bar = document.createElement("p");
      bar.className = "tools";
      const buttons = [
        ["+", "zoom in", () => this.narrow(STEP)],
        ["−", "zoom out", () => this.narrow(1 / STEP)],
        ["◂", "earlier", () => this.shift(-0.25)],
        ["▸", "later", () => this.shift(0.25)],
        ["whole", "show the whole figure", () => this.reset()],
      ];
      for (const [text, label, act] of buttons) {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = text;
        button.setAttribute("aria-label", label);
        button.title = label;
        button.addEventListener("click", act);
        bar.append(button);
      }
      this.reading = document.createElement("output");
      this.reading.setAttribute("aria-live", "polite");
      this.reading.textContent = "drag over a stretch to see it larger";
      bar.append(this.reading);
      this.svg.after(bar);
    }

    // every axes that shares the abscissa goes along
    go(x) {
      const [low, high] = this.active.whole.x;
      let [from, to] = [Math.max(low, x[0]), Math.min(high, x[1])];
      if (!(to - from > (high - low) * 1e-6)) return;
      for (const axes of this.axes) if (axes.group === this.active.group) axes.set([from, to]);
    }

    narrow(share) {
      const axes = this.active;
      const [low, high] = axes.now.x.map(axes.fx);
      const [middle, half] = [(low + high) / 2, ((high - low) / 2) * share];
      this.go([middle - half, middle + half].map(back(axes.logx)));
    }

    shift(share) {
      const axes = this.active;
      const [low, high] = axes.now.x.map(axes.fx);
      const [first, last] = axes.whole.x.map(axes.fx);
      const by = Math.max(first - low, Math.min(last - high, share * (high - low)));
      this.go([low + by, high + by].map(back(axes.logx)));
    }

    reset() {
      for (const axes of this.axes) axes.set(axes.whole.x);
    }

    at(event) {
      const point = new DOMPoint(event.clientX, event.clientY);
      return point.matrixTransform(this.svg.getScreenCTM().inverse());
    }

    under(point) {
      return this.axes.find(({ box: [x, y, width, height] }) =>
        point.x >= x && point.x <= x + width && point.y >= y && point.y <= y + height);
    }

    listen() {
      const { svg } = this;
      let start = null;
      svg.addEventListener("pointerdown", (event) => {
        const point = this.at(event);
        const axes = this.under(point);
        if (!axes || event.button !== 0) return;
        this.active = axes;
        start = point.x;
        svg.setPointerCapture(event.pointerId);
      });
      svg.addEventListener("pointermove", (event) => {
        const point = this.at(event);
        if (start !== null) {
          const { brush, box: [x, , width] } = this.active;
          const [a, b] = [start, point.x].map((v) => Math.max(x, Math.min(x + width, v)));
          brush.setAttribute("x", Math.min(a, b));
          brush.setAttribute("width", Math.abs(b - a));
          brush.setAttribute("visibility", "visible");
        }
        this.show(point);
      });
      const finish = (event) => {
        if (start === null) return;
        const end = this.at(event).x;
        const axes = this.active;
        axes.brush.setAttribute("visibility", "hidden");
        // less than this is a click that shook
        if (Math.abs(end - start) > 4) {
          const [a, b] = [start, end].map((v) => axes.value(v));
          this.go([Math.min(a, b), Math.max(a, b)]);
        }
        start = null;
      };
      svg.addEventListener("pointerup", finish);
      svg.addEventListener("pointercancel", () => {
        this.active.brush.setAttribute("visibility", "hidden");
        start = null;
      });
      svg.addEventListener("dblclick", () => this.reset());
      svg.addEventListener("pointerleave", () => {
        for (const axes of this.axes) axes.guide.setAttribute("visibility", "hidden");
      });
      svg.tabIndex = 0;
      svg.addEventListener("keydown", (event) => {
        const acts = {
          "+": () => this.narrow(STEP),
          "=": () => this.narrow(STEP),
          "-": () => this.narrow(1 / STEP),
          ArrowLeft: () => this.shift(-0.25),
          ArrowRight: () => this.shift(0.25),
          Escape: () => this.reset(),
          0: () => this.reset(),
        };
        if (!acts[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        acts[event.key]();
      });
      addEventListener("beforeprint", () => this.reset());
    }

    show(point) {
      const axes = this.under(point);
      for (const one of this.axes) one.guide.setAttribute("visibility", "hidden");
      if (!axes) return;
      for (const name of ["x1", "x2"]) axes.guide.setAttribute(name, point.x);
      axes.guide.setAttribute("visibility", "visible");
      const words = axes.read(axes.value(point.x));
      if (words) this.reading.textContent = words;
    }
  }

  for (const svg of document.querySelectorAll("figure svg")) {
    const spec = svg.querySelector("metadata.curves");
    if (spec) new Figure(svg, JSON.parse(spec.textContent));
  }
})();
