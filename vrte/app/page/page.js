// What the page does in the browser, without asking the server: it only tells it (emitEvent) what it must know.
window.vrte = {
  // once a page is there: `upload` is the element that takes files
  begin(upload) {
    this.upload = upload;
    document.documentElement.lang = "en";
    this.take_drops(upload);
    this.remember_focus();
    this.follow_theme();
    window.addEventListener("hashchange", () => this.tell_link());
    this.tell_link();
  },

  // the dialog that chooses a file
  pick(upload, suffixes = "") {
    const found = getElement(upload);
    if (suffixes) found.$el.querySelector("input[type=file]").accept = suffixes;
    found.$refs.qRef.pickFiles();
  },

  // a file dropped anywhere on the page goes where a chosen one goes
  take_drops(upload) {
    const over = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");
    const lit = (on) => document.body.classList.toggle("vrte-dropping", on);
    document.addEventListener("dragover", (event) => {
      if (over(event)) event.preventDefault(), lit(true);
    });
    document.addEventListener("dragleave", (event) => event.relatedTarget ?? lit(false));
    document.addEventListener("drop", (event) => {
      if (!over(event)) return;
      event.preventDefault();
      lit(false);
      getElement(upload)?.$refs.qRef.addFiles(event.dataTransfer.files);
    });
  },

  // "auto", "light" or "dark"; kept by this browser, the server hears which of the two it is
  follow_theme() {
    const system = matchMedia("(prefers-color-scheme: dark)");
    const apply = () => {
      const dark = this.theme() === "dark" || (this.theme() === "auto" && system.matches);
      emitEvent("vrte-theme", { theme: this.theme(), dark, comma: (1.5).toLocaleString().includes(",") });
    };
    system.addEventListener("change", apply);
    this.set_theme = (theme) => {
      try {
        localStorage.setItem("vrte-theme", theme);
      } catch {
        this.kept_theme = theme; // a browser that keeps nothing
      }
      apply();
    };
    apply();
  },
  theme() {
    try {
      return localStorage.getItem("vrte-theme") ?? "auto";
    } catch {
      return this.kept_theme ?? "auto";
    }
  },

  // the scene that the address carries
  tell_link() {
    const found = location.hash.match(/^#scene=([A-Za-z0-9_-]+)$/);
    if (found && found[1].length <= 200000) emitEvent("vrte-link", found[1]);
  },
  async carry(text) {
    const address = `${location.origin}${location.pathname}#scene=${text}`;
    history.replaceState(null, "", `#scene=${text}`);
    let copied = true;
    try {
      await navigator.clipboard.writeText(address);
    } catch {
      copied = false; // not every browser lets a page write there
    }
    emitEvent("vrte-carried", copied);
  },

  // Enter in a field that holds text; the field first says what is in it
  entered(event, act) {
    const field = event.target;
    if (!field.matches("input[type=text]:not([role=combobox]), input:not([type]):not([role=combobox])")) return;
    field.dispatchEvent(new Event("change"));
    setTimeout(act, 60);
  },

  // the form is drawn anew after some changes: the field that had the focus gets it again
  remember_focus() {
    document.addEventListener("focusin", ({ target }) => {
      const label = target.closest(".vrte-left") && target.getAttribute("aria-label");
      this.focused = label ? [label, this.labelled(label).indexOf(target)] : null;
    });
  },
  labelled(label) {
    return [...document.querySelectorAll(".vrte-left [aria-label]")].filter((one) => one.getAttribute("aria-label") === label);
  },
  focus_again() {
    const [label, place] = this.focused ?? [];
    if (label && document.activeElement === document.body) this.labelled(label)[place]?.focus();
  },
  jump(id) {
    const place = getHtmlElement(id);
    const field = place?.matches("input") ? place : place?.querySelector("input");
    (field ?? place)?.scrollIntoView({ block: "center" });
    field?.focus();
  },
  show_result() {
    if (matchMedia("(max-width: 899px)").matches) document.querySelector(".vrte-right").scrollIntoView({ behavior: "smooth" });
  },

  // arrow keys turn the lobe, plus and minus bring it nearer or farther
  turn(event, id) {
    const plot = getElement(id);
    const camera = plot?.$el?._fullLayout?.scene?._scene?.getCamera();
    if (!camera) return;
    const { x, y, z } = camera.eye;
    let [around, up, far] = [Math.atan2(y, x), Math.atan2(z, Math.hypot(x, y)), Math.hypot(x, y, z)];
    const step = Math.PI / 24;
    if (event.key === "ArrowLeft") around -= step;
    else if (event.key === "ArrowRight") around += step;
    else if (event.key === "ArrowUp") up = Math.min(up + step, 1.55);
    else if (event.key === "ArrowDown") up = Math.max(up - step, -1.55);
    else if (event.key === "+") far /= 1.1;
    else if (event.key === "-") far *= 1.1;
    else return;
    event.preventDefault();
    const flat = far * Math.cos(up);
    camera.eye = { x: flat * Math.cos(around), y: flat * Math.sin(around), z: far * Math.sin(up) };
    plot.Plotly.relayout(plot.$el, { "scene.camera": camera });
    emitEvent("vrte-camera", camera);
  },

  // a figure as a file, with the title that the page shows above it
  picture(id, title, filename) {
    const plot = getElement(id);
    const layout = { ...plot.$el.layout, title: { text: title, x: 0.02, xanchor: "left", y: 0.97, yanchor: "top" } };
    layout.margin = { ...layout.margin, t: 100 };
    const options = { format: "png", width: 1200, height: 900, scale: 2, filename };
    plot.Plotly.downloadImage({ data: plot.$el.data, layout }, options);
  },
};
