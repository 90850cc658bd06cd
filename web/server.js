// What the page asks its server.

export let session = null;

export class Refused extends Error {}

async function answered(reply) {
  const body = await reply.json().catch(() => ({}));
  if (!reply.ok) throw new Refused(body.error ?? `${reply.status}`);
  return body;
}

export async function look(path) {
  return answered(await fetch(path, {cache: 'no-store'}));
}

// A server that does not answer in this time is lost: Stop must not wait for one that hangs.
const patience_ms = path => path === '/api/stop' ? 3000 : 60000;

export async function act(path, body = {}) {
  return answered(await fetch(path, {
    method: 'POST',
    signal: AbortSignal.timeout(patience_ms(path)),
    headers: {'Content-Type': 'application/json', 'X-Etalon-Action': session.action_token},
    body: JSON.stringify(body),
  }));
}

export async function begin() {
  session = await look('/api/session');
  return session;
}

// Calls `changed` with every state and `lost` while there is no connection, or one on which nothing
// is heard: the server says every two seconds that it is alive. A server that was started again has
// another token: the page is loaded again. A page that is not seen holds no connection: a browser
// has six for a server, and Stop needs one.
export function follow(changed, lost) {
  const events = new EventSource('/api/events');
  const silence_ms = 6000;
  let heard = Date.now();
  const watch = setInterval(() => {
    if (Date.now() - heard > silence_ms) events.onerror();
  }, 1000);
  const end = () => {
    clearInterval(watch);
    events.close();
  };
  const again = () => {
    if (!document.hidden) return;
    end();
    document.removeEventListener('visibilitychange', again);
    document.addEventListener('visibilitychange', () => follow(changed, lost), {once: true});
  };
  document.addEventListener('visibilitychange', again);
  events.addEventListener('alive', () => { heard = Date.now(); });
  events.onmessage = async event => {
    heard = Date.now();
    if (events.wasLost) {
      events.wasLost = false;
      const now = await look('/api/session').catch(() => null);
      if (now && now.action_token !== session.action_token) return location.reload();
    }
    changed(JSON.parse(event.data));
  };
  events.onerror = () => {
    events.wasLost = true;
    lost();
    if (events.readyState !== EventSource.CLOSED) return;
    end();
    document.removeEventListener('visibilitychange', again);
    setTimeout(() => follow(changed, lost), 2000);
  };
}
