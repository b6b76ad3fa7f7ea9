/* A worker in a hidden frame, for pages read from a file: browsers start no worker from there. Search needs one. */
class FrameWorker extends EventTarget {
  constructor(url) {
    super();
    this.ready = new Promise((resolve) => {
      const frame = document.createElement("iframe");
      frame.hidden = true;
      frame.onload = () => resolve(this.frame.contentWindow);
      this.frame = frame;
      window.addEventListener("message", (event) => {
        if (event.source === frame.contentWindow) {
          const answer = new MessageEvent("message", { data: event.data });
          this.dispatchEvent(answer);
          if (this.onmessage) this.onmessage(answer);
        }
      });
      const start = "<script>postMessage = (data) => parent.postMessage(data, '*')<\/script>";
      frame.srcdoc = `${start}<script src="${new URL(url, location.href)}"><\/script>`;
      document.body.appendChild(frame);
    });
  }

  postMessage(data) {
    this.ready.then((inner) => inner.dispatchEvent(new MessageEvent("message", { data })));
  }

  terminate() {
    this.frame.remove();
  }
}

if (location.protocol === "file:") window.Worker = FrameWorker;
