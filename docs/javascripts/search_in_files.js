// Browsers start no worker for pages that are opened from files. The search's then runs in a frame.
if (location.protocol === "file:")
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      this.waiting = [];
      addEventListener("message", ({ source, data }) => {
        if (source === frame.contentWindow)
          this.dispatchEvent(new MessageEvent("message", { data }));
      });
      const begin = () => {
        document.body.append(frame);
        const page = frame.contentDocument;
        page.open();
        page.write(
          `<script>
            postMessage = (data) => parent.dispatchEvent(
              new MessageEvent("message", { source: window, data }));
            importScripts = (...urls) => urls.reduce((before, url) => before.then(() =>
              new Promise((loaded) => {
                const script = document.createElement("script");
                script.src = url;
                script.onload = loaded;
                document.head.append(script);
              })), Promise.resolve());
            document.currentScript.remove();
          </` + `script><script src="${url}"></` + `script>`
        );
        page.close();
        frame.contentWindow.addEventListener("load", () => {
          const waiting = this.waiting;
          this.waiting = null;
          for (const data of waiting) this.tell(frame, data);
        });
        this.frame = frame;
      };
      document.body ? begin() : addEventListener("DOMContentLoaded", begin);
    }
    tell(frame, data) {
      frame.contentWindow.dispatchEvent(new MessageEvent("message", { data }));
    }
    postMessage(data) {
      this.waiting ? this.waiting.push(data) : this.tell(this.frame, data);
    }
    terminate() {
      this.frame.remove();
    }
  };
