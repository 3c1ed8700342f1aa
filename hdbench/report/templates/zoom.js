// Zoom and read-out of the figures. Without it the figures are whole, only still.
(() => {
  "use strict";
  const NS = "http://www.w3.org/2000/svg";
  const PAIR = /(-?[\d.]+(?:e-?\d+)?)[ ,](-?[\d.]+(?:e-?\d+)?)/g;
  const STEP = 0.6; // a press of + leaves this share of the abscissa
  const LEAST = 0.05; // narrowest view, in points of the drawing: it is written to 0.001

  const make = (tag, attributes) => {
    const element = document.createElementNS(NS, tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    return element;
  };

  // steps of 1, 2 or 5 between two ends, at most `most` of them, with the digits they need
  const ticks = (low, high, most) => {
    if (low > high) return ticks(high, low, most);
    const rough = (high - low) / most;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= rough);
    const places = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
    const found = [];
    for (let k = Math.ceil(low / step); k * step <= high; k += 1) found.push([k * step, places]);
    return found;
  };

  // with a minus as the still labels have it, and none before a zero
  const signed = (text) => text.replace(/^-(0\.?0*)$/, "$1").replace("-", "−");

  const digits = (value, span) =>
    signed(
      Math.abs(value) >= 1e5 || span < 1e-4
        ? value.toExponential(3)
        : value.toFixed(Math.min(9, Math.max(0, Math.ceil(3 - Math.log10(span || 1))))),
    );

  // one pair of axes; `view` is the part of the still drawing that is seen, in its own points
  class Axes {
    constructor(svg, spec) {
      Object.assign(this, spec);
      const [left, top, width, height] = spec.box;
      this.whole = { left, right: left + width, top, bottom: top + height };
      const group = svg.querySelector(`[id$="-axes_${spec.at + 1}"]`);
      const data = [...group.querySelectorAll("[clip-path]")].filter((e) => !e.closest('[id*="matplotlib.axis"]'));
      this.still = [...group.querySelectorAll('[id*="tick_"]')];
      this.curves = spec.labels.map((label, k) => ({ label, points: this.points(group, k) }));
      // the parts move inside of one clip that stays
      const frame = make("g", { "clip-path": data[0].getAttribute("clip-path") });
      let first = data[0];
      while (first.parentNode !== group) first = first.parentNode;
      group.insertBefore(frame, first);
      this.parts = [];
      for (const part of data) {
        const curve = part.closest('[id*="-curve-"]');
        part.removeAttribute("clip-path");
        frame.append(part);
        for (const path of part.matches("path") ? [part] : part.querySelectorAll("path"))
          this.parts.push([path, (m) => path.setAttribute("d", m.path), path.getAttribute("d")]);
        for (const use of part.querySelectorAll("use")) {
          if (curve) this.parts.push([use, (m) => { use.setAttribute("x", m.x); use.setAttribute("y", m.y); }]);
          else this.parts.push([use, (m) => use.setAttribute("transform", m.matrix)]);
        }
      }
      this.parts = this.parts.map(([element, move, d]) =>
        ({ move, d, x: +element.getAttribute("x"), y: +element.getAttribute("y") }));
      // texts inside of the frame stand at data; title and legend do not
      this.notes = [...group.querySelectorAll(':scope > [id*="-text_"]')]
        .map((element) => ({ element, at: element.querySelector("text") }))
        .map(({ element, at }) => ({ element, x: +at.getAttribute("x"), y: +at.getAttribute("y") }))
        .filter(({ y }) => y > top && y < top + height);
      this.marks = make("g", { class: "marks" });
      frame.before(this.marks);
      this.guide = make("line", { class: "guide", y1: top, y2: top + height, visibility: "hidden" });
      this.brush = make("rect", { class: "brush", y: top, height, width: 0, visibility: "hidden" });
      svg.append(this.guide, this.brush);
      this.view = this.whole;
    }

    points(group, k) {
      const curve = group.querySelector(`[id$="-curve-${this.at}-${k}"]`);
      const path = curve.querySelector(":scope > path");
      return path
        ? [...path.getAttribute("d").matchAll(PAIR)].map((pair) => [+pair[1], +pair[2]])
        : [...curve.querySelectorAll("use")].map((u) => [+u.getAttribute("x"), +u.getAttribute("y")]);
    }

    // values at a place of the still drawing
    valueX(px) {
      const value = this.x[0] + ((px - this.whole.left) / this.box[2]) * (this.x[1] - this.x[0]);
      return this.logx ? 10 ** value : value;
    }

    valueY(py) {
      const value = this.y[0] + ((this.whole.bottom - py) / this.box[3]) * (this.y[1] - this.y[0]);
      return this.logy ? 10 ** value : value;
    }

    // place of the still drawing under a place of the zoomed one
    under(px) {
      return this.view.left + ((px - this.box[0]) / this.box[2]) * (this.view.right - this.view.left);
    }

    show(left, right) {
      const zoomed = left > this.whole.left || right < this.whole.right;
      this.view = zoomed ? { left, right, ...this.fitted(left, right) } : this.whole;
      const { top, bottom } = this.view;
      const sx = this.box[2] / (this.view.right - this.view.left);
      const sy = this.box[3] / (bottom - top);
      const x = (v) => this.box[0] + sx * (v - this.view.left);
      const y = (v) => this.box[1] + sy * (v - top);
      const matrix = `matrix(${sx} 0 0 ${sy} ${x(0)} ${y(0)})`;
      const moved = (d) => d.replace(PAIR, (_, a, b) => `${x(a).toFixed(3)} ${y(b).toFixed(3)}`);
      for (const part of this.parts) {
        part.move({ path: part.d && (zoomed ? moved(part.d) : part.d), x: x(part.x), y: y(part.y), matrix });
      }
      for (const note of this.notes) {
        note.element.setAttribute("transform", `translate(${x(note.x) - note.x} ${y(note.y) - note.y})`);
        const inside = x(note.x) >= this.whole.left && x(note.x) <= this.whole.right;
        note.element.style.display = inside ? "" : "none";
      }
      for (const tick of this.still) tick.style.display = zoomed ? "none" : "";
      this.marks.replaceChildren();
      if (zoomed) this.drawTicks(x, y);
    }

    // highest and lowest point between two abscissae, with a margin
    fitted(left, right) {
      const seen = this.curves.flatMap(({ points }) => points.filter(([px]) => px >= left && px <= right));
      const ys = seen.map(([, py]) => py);
      const [top, bottom] = ys.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
      const margin = 0.05 * (bottom - top);
      return margin > 0 ? { top: top - margin, bottom: bottom + margin } : { top: this.whole.top, bottom: this.whole.bottom };
    }

    drawTicks(x, y) {
      const { left, right, top, bottom } = this.whole;
      const add = (at, line, label) => {
        const text = make("text", label);
        text.textContent = at;
        this.marks.append(make("line", line), text);
      };
      const scale = (ends, log) => ends.map((v) => (log ? Math.log10(v) : v));
      const text = (v, places, log) => signed(log ? (10 ** v).toPrecision(3) : v.toFixed(places));
      const from = (v, [low, high], start, length) => start + ((v - low) / (high - low)) * length;
      for (const [v, places] of ticks(...scale([this.valueX(this.view.left), this.valueX(this.view.right)], this.logx), 6)) {
        const px = x(from(v, this.x, left, this.box[2]));
        add(text(v, places, this.logx), { x1: px, x2: px, y1: top, y2: bottom }, { x: px, y: bottom + 12, "text-anchor": "middle" });
      }
      for (const [v, places] of ticks(...scale([this.valueY(this.view.bottom), this.valueY(this.view.top)], this.logy), 5)) {
        const py = y(from(v, this.y, bottom, -this.box[3]));
        add(text(v, places, this.logy), { y1: py, y2: py, x1: left, x2: right }, { x: left - 4, y: py + 3, "text-anchor": "end" });
      }
    }

    // what the curves are next to a place of the zoomed drawing
    read(px) {
      const at = this.under(px);
      const span = this.valueY(this.view.top) - this.valueY(this.view.bottom);
      const inside = ({ points }) => points.length > 1 && points.some(([px]) => px >= at) && points.some(([px]) => px <= at);
      const here = this.curves.filter(inside);
      const named = here.filter(({ label }) => label);
      const words = (named.length ? named : here.slice(0, 1)).map(({ label, points }) => {
        const near = points.reduce((best, point) => (Math.abs(point[0] - at) < Math.abs(best[0] - at) ? point : best));
        return `${label || this.ylabel} ${digits(this.valueY(near[1]), span)}`;
      });
      const x = digits(this.valueX(at), this.valueX(this.view.right) - this.valueX(this.view.left));
      return `${this.xlabel || "x"} ${x}${words.length ? ": " : ""}${words.join(", ")}`;
    }
  }

  const prepare = (svg, specs) => {
    const all = specs.map((spec) => new Axes(svg, spec));
    let active = all[0];
    const go = (left, right) => {
      const ends = active.whole;
      const [from, to] = [Math.max(ends.left, left), Math.min(ends.right, right)];
      if (to - from < LEAST) return;
      // axes that share their abscissa go along
      for (const axes of all) if (axes.group === active.group) axes.show(from, to);
    };
    const narrow = (share) => {
      const { left, right } = active.view;
      const [middle, half] = [(left + right) / 2, ((right - left) / 2) * share];
      go(middle - half, middle + half);
    };
    const shift = (share) => {
      const { left, right } = active.view;
      const by = share * (right - left);
      const kept = Math.max(active.whole.left - left, Math.min(active.whole.right - right, by));
      go(left + kept, right + kept);
    };
    const reset = () => all.forEach((axes) => axes.show(axes.whole.left, axes.whole.right));
    const acts = [
      ["+", "zoom in", ["+", "="], () => narrow(STEP)],
      ["−", "zoom out", ["-"], () => narrow(1 / STEP)],
      ["◂", "earlier", ["ArrowLeft"], () => shift(-0.25)],
      ["▸", "later", ["ArrowRight"], () => shift(0.25)],
      ["whole", "show the whole figure", ["0", "Escape"], reset],
    ];
    const bar = document.createElement("p");
    bar.className = "tools";
    for (const [text, label, , act] of acts) {
      const button = document.createElement("button");
      Object.assign(button, { type: "button", textContent: text, title: label, ariaLabel: label, onclick: act });
      bar.append(button);
    }
    const reading = document.createElement("output");
    reading.textContent = "drag over a stretch to see it larger";
    bar.append(reading);
    svg.after(bar);

    const at = (event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const under = ({ x, y }) => all.find(({ whole: w }) => x >= w.left && x <= w.right && y >= w.top && y <= w.bottom);
    let start = null;
    svg.tabIndex = 0;
    svg.onkeydown = (event) => {
      const act = acts.find(([, , keys]) => keys.includes(event.key));
      if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      act[3]();
    };
    svg.onpointerdown = (event) => {
      const point = at(event);
      if (!under(point) || event.button !== 0) return;
      active = under(point);
      start = point.x;
      svg.setPointerCapture(event.pointerId);
    };
    svg.onpointermove = (event) => {
      const point = at(event);
      if (start !== null) {
        const [a, b] = [start, point.x].map((v) => Math.max(active.whole.left, Math.min(active.whole.right, v)));
        active.brush.setAttribute("x", Math.min(a, b));
        active.brush.setAttribute("width", Math.abs(b - a));
        active.brush.setAttribute("visibility", "visible");
      }
      const axes = under(point);
      for (const one of all) one.guide.setAttribute("visibility", one === axes ? "visible" : "hidden");
      if (!axes) return;
      for (const name of ["x1", "x2"]) axes.guide.setAttribute(name, point.x);
      reading.textContent = axes.read(point.x);
    };
    const finish = (event) => {
      if (start === null) return;
      active.brush.setAttribute("visibility", "hidden");
      const [a, b] = [start, at(event).x];
      start = null;
      // less than this is a click that shook
      if (event.type === "pointerup" && Math.abs(a - b) > 4) go(active.under(Math.min(a, b)), active.under(Math.max(a, b)));
    };
    svg.onpointerup = finish;
    svg.onpointercancel = finish;
    svg.onpointerleave = () => all.forEach((axes) => axes.guide.setAttribute("visibility", "hidden"));
    svg.ondblclick = reset;
    addEventListener("beforeprint", reset);
  };

  for (const svg of document.querySelectorAll("figure svg")) {
    const spec = svg.querySelector("metadata.axes");
    if (spec) prepare(svg, JSON.parse(spec.textContent));
  }
})();
