// The socket to the page's process: JSON comes as text, pictures as one binary message each.

// The page's process says once a second that it is there. Whoever hears nothing (a sleeping computer,
// a cut line, a process that hangs) must not take for true what is on the screen.
const RETRY_MS = 1000, SILENT_MS = 4000, GIVEN_UP_MS = 12_000;

export class Line {
  constructor(hear) {
    this.hear = hear;
    this.over = false;
    this.lost = false;
    this.open();
    setInterval(() => this.listen(), 1000);
  }

  open() {
    const address = new URL("socket", location.href);
    address.protocol = "ws:";
    this.heard = Date.now();
    const socket = this.socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => {
      this.heard = Date.now();
      if (this.lost) this.hear({ kind: "back" });
      this.lost = false;
      this.hear(typeof event.data === "string" ? JSON.parse(event.data) : unpack(event.data));
    };
    socket.onclose = () => this.again();
  }

  // Sleep stops timers: the first look afterwards finds a long silence.
  listen() {
    const silent = Date.now() - this.heard;
    if (this.over || silent < SILENT_MS) return;
    this.lose();
    if (silent > GIVEN_UP_MS) this.again();
  }

  lose() {
    if (!this.lost) this.hear({ kind: "lost", since: this.heard });
    this.lost = true;
  }

  again() {
    if (this.over) return;
    this.lose();
    this.socket.onclose = this.socket.onmessage = null;
    this.socket.close();
    this.heard = Date.now();
    setTimeout(() => this.open(), RETRY_MS);
  }

  ask(command) {
    if (this.socket.readyState === WebSocket.OPEN && !this.lost) this.socket.send(JSON.stringify(command));
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
