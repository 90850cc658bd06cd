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

export async function act(path, body = {}) {
  return answered(await fetch(path, {
    method: 'POST',
    headers: {'Content-Type': 'application/json', 'X-Etalon-Action': session.action_token},
    body: JSON.stringify(body),
  }));
}

export async function begin() {
  session = await look('/api/session');
  return session;
}

// Calls `changed` with every state and `lost` while there is no connection. A server that was
// started anew has another token: the page is loaded again.
export function follow(changed, lost) {
  const events = new EventSource('/api/events');
  events.onmessage = async event => {
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
    if (events.readyState === EventSource.CLOSED) setTimeout(() => follow(changed, lost), 2000);
  };
}
