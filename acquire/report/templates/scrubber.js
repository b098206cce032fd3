// Direct and global light at the pitch that the slider is at, exposed and marked like the mix.

class Scrubber {
  constructor(section, remix) {
    const { height, width } = facts.pitch;
    this.section = section;
    this.mix = remix === null ? PLAIN : remix.mix;
    this.light = null;
    this.views = ["direct", "global"].map((name) => {
      const canvas = section.querySelector(`#${name}-canvas`);
      canvas.height = height;
      canvas.width = width;
      return canvas.getContext("2d");
    });
    this.label = section.querySelector("#pitch-said");
    this.slider = section.querySelector("#pitch");
    this.slider.addEventListener("input", () => this.show());
    document.addEventListener("mixchange", () => this.show());
    this.label.textContent = facts.pitches[0].label;
    onceSeen(section, () => this.fill().catch(failed));
  }

  async fill() {
    this.light = await lightOf("direct", "global", "pitch-flags");
    this.show();
    this.section.dataset.filled = "";
  }

  show() {
    const index = Number(this.slider.value);
    this.label.textContent = facts.pitches[index].label;
    if (this.light === null) return;
    const { height, width } = facts.pitch;
    const count = height * width;
    const flags = this.light[2];
    const gain = facts.display_gain * 2 ** this.mix.exposure;
    this.views.forEach((context, view) => {
      const light = this.light[view];
      const image = context.createImageData(width, height);
      for (let i = 0; i < count; i++) {
        const mark = marked(flags[i], this.mix.overlay === SHOW_MARKS);
        for (let c = 0; c < 3; c++) {
          const value = light[3 * (index * count + i) + c] * gain;
          image.data[4 * i + c] = mark === null ? 255 * screen(value, this.mix.tone) : mark[c];
        }
        image.data[4 * i + 3] = 255;
      }
      context.putImageData(image, 0, 0);
    });
  }
}

const SHOW_MARKS = -1;
const PLAIN = { exposure: 0, tone: "srgb", overlay: -2 };

// The colour of what was not measured, and of more where it is asked for; null for none.
function marked(flag, all) {
  if (flag & 1 || (all && flag & 2)) return facts.marks[0];
  return all && flag & 4 ? facts.marks[1] : null;
}

function screen(light, tone) {
  let value = Math.max(light, 0);
  if (tone === "soft") value = (value * (1 + value / 16)) / (1 + value);
  value = Math.min(value, 1);
  return value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;
}
