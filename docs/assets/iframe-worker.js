/* Search from files: browsers start no worker from a page that was opened as a file, so its script runs in a hidden
   frame instead. The name is the one by which the plugin "offline" knows that such a script is here. */
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      this.frame = document.createElement("iframe")
      this.frame.hidden = true
      this.frame.srcdoc = "<!doctype html><title>search</title><body></body>"
      this.ready = new Promise((resolve) => {
        this.frame.onload = () => resolve(this.start(new URL(url, location)))
      })
      const place = () => document.body.append(this.frame)
      if (document.body) place()
      else addEventListener("DOMContentLoaded", place)
    }

    async start(url) {
      const inside = this.frame.contentWindow
      const load = (source) =>
        new Promise((resolve, reject) => {
          const script = inside.document.createElement("script")
          Object.assign(script, { src: source, onload: resolve, onerror: reject })
          inside.document.body.append(script)
        })
      inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }))
      inside.importScripts = (...sources) =>
        sources.reduce((before, source) => before.then(() => load(new URL(source, url))), Promise.resolve())
      await load(url)
      return inside
    }

    async postMessage(data) {
      const inside = await this.ready
      inside.dispatchEvent(new inside.MessageEvent("message", { data }))
    }

    terminate() {
      this.frame.remove()
    }
  }
}
