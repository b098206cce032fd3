// The socket to the page's process: JSON comes as text, pictures as one binary message each.

const RETRY_MS = 1000;

export class Line {
  constructor(hear) {
    this.hear = hear;
    this.over = false;
    this.open();
  }

  open() {
    const address = new URL("socket", location.href);
    address.protocol = "ws:";
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = (event) =>
      this.hear(typeof event.data === "string" ? JSON.parse(event.data) : unpack(event.data));
    this.socket.onclose = () => {
      if (this.over) return;
      this.hear({ kind: "lost" });
      setTimeout(() => this.open(), RETRY_MS);
    };
  }

  ask(command) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(command));
  }
}

function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let at = 4 + length;
  head.files = head.sizes.map((size) => {
    const file = new Uint8Array(buffer, at, size);
    at += size;
    return file;
  });
  return head;
}
