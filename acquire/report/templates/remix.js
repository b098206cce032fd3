// The controls of the remix: gains of two mixes, presets, exposure, tone, wipe, overlay, download.

class Remix {
  constructor(section, components, flags) {
    this.section = section;
    this.canvas = section.querySelector("canvas");
    this.mixer = new Mixer(this.canvas, components, flags);
    this.mix = {
      gains: { A: [...facts.presets["as-captured"]], B: [...facts.presets["as-captured"]] },
      exposure: 0, tone: "srgb", wipe: 1, overlay: -2,
    };
    this.side = "A";
    this.waiting = false;
    this.listen();
    this.show();
    this.mixer.draw(this.mix);
  }

  listen() {
    const on = (selector, kind, act) => {
      for (const element of this.section.querySelectorAll(selector)) {
        element.addEventListener(kind, () => { act(element); this.show(); this.redraw(); });
      }
    };
    on("[name=side]", "change", (radio) => this.edit(radio.value));
    on("[data-gain]", "input", (slider) => {
      this.mix.gains[this.side][Number(slider.dataset.gain)] = Number(slider.value);
    });
    on("[data-preset]", "click", (button) => {
      this.mix.gains[this.side] = [...facts.presets[button.dataset.preset]];
    });
    on("#exposure", "input", (slider) => { this.mix.exposure = Number(slider.value); });
    on("#tone", "change", (select) => { this.mix.tone = select.value; });
    on("#wipe", "input", (slider) => { this.mix.wipe = Number(slider.value) / 100; });
    on("#overlay", "change", (select) => this.lay(Number(select.value)));
    this.section.querySelector("#download").addEventListener("click", () => this.download());
    this.canvas.addEventListener("webglcontextlost", () => {
      this.section.querySelector("#live-problem").textContent =
        "The graphics card dropped the picture. Load the page again.";
    });
  }

  async lay(overlay) {
    if (overlay >= 0) this.mixer.take((await lightOf("deviations"))[0]);
    this.mix.overlay = overlay;
    this.show();
    this.redraw();
  }

  edit(side) {
    this.side = side;
    if (side === "B" && this.mix.wipe === 1) this.mix.wipe = 0.5;
  }

  // Puts the state into words beside every control.
  show() {
    const { gains, exposure, wipe } = this.mix;
    for (const slider of this.section.querySelectorAll("[data-gain]")) {
      const gain = gains[this.side][Number(slider.dataset.gain)];
      slider.value = gain;
      slider.parentElement.querySelector("output").textContent = `×${gain.toFixed(2)}`;
    }
    for (const button of this.section.querySelectorAll("[data-preset]")) {
      const same = facts.presets[button.dataset.preset].every((g, k) => g === gains[this.side][k]);
      button.setAttribute("aria-pressed", same);
    }
    const stops = exposure > 0 ? `+${exposure.toFixed(1)}` : exposure.toFixed(1).replace("-", "−");
    this.section.querySelector("#exposure-said").textContent = `${stops} stops`;
    this.section.querySelector("#wipe").value = 100 * wipe;
    this.section.querySelector("#wipe-said").textContent =
      wipe === 1 ? "A only" : wipe === 0 ? "B only" : `A to ${Math.round(100 * wipe)} %, then B`;
    const line = this.section.querySelector(".border");
    line.hidden = wipe === 0 || wipe === 1;
    line.style.left = `${100 * wipe}%`;
    const uncertain = this.mix.overlay >= 0;
    const legend = this.section.querySelector(".ramp");
    if (legend) legend.hidden = !uncertain;
  }

  redraw() {
    document.dispatchEvent(new Event("mixchange"));
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.mixer.draw(this.mix);
    });
  }

  download() {
    // Drawn and read in one go: the browser forgets a canvas that it has shown.
    this.mixer.draw(this.mix);
    this.canvas.toBlob((blob) => {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = "mix.png";
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
    }, "image/png");
  }
}
