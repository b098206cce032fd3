// Direct and global light at the pitch that the slider is at, both exposed like the white picture.

class Scrubber {
  constructor(section, light) {
    const { height, width } = facts.pitch;
    this.views = ["direct", "global"].map((name) => {
      const canvas = section.querySelector(`#${name}-canvas`);
      canvas.height = height;
      canvas.width = width;
      return { context: canvas.getContext("2d"), light: light[name] };
    });
    this.label = section.querySelector("#pitch-said");
    const slider = section.querySelector("#pitch");
    slider.addEventListener("input", () => this.show(Number(slider.value)));
    this.show(Number(slider.value));
  }

  show(index) {
    this.label.textContent = facts.pitches[index].label;
    const { height, width } = facts.pitch;
    const count = height * width;
    for (const { context, light } of this.views) {
      const image = context.createImageData(width, height);
      for (let i = 0; i < count; i++) {
        for (let c = 0; c < 3; c++) {
          const value = light[3 * (index * count + i) + c] * facts.display_gain;
          image.data[4 * i + c] = 255 * srgb(value);
        }
        image.data[4 * i + 3] = 255;
      }
      context.putImageData(image, 0, 0);
    }
  }
}

function srgb(light) {
  const clipped = Math.min(Math.max(light, 0), 1);
  return clipped <= 0.0031308 ? 12.92 * clipped : 1.055 * clipped ** (1 / 2.4) - 0.055;
}
