// Every text of the page, in both languages: a test checks that neither lacks one. What a program,
// a file or a device says is shown as it is, in English.

export const strings = {
  en: {
    stop: 'STOP', stop_label: 'Stop every axis and what goes on', views: 'Views',
    view_setup: 'Set up', view_run: 'Run', view_fleet: 'Fleet', language: 'Language',
    yes: 'Yes', no: 'No',
    lost: 'The connection to the station\u2019s computer is lost. A run may go on. To stop, use the emergency stop.',
    idle: 'This page moves nothing.', by_since: '{what} by {who} since {time}',
    work_run: 'A run', work_homing: 'Homing', work_motion: 'A motion',
    stop_stopping: 'Stopping \u2026', stop_confirmed: 'Stopped: the controller confirms that no axis moves.',
    stop_failed: 'NOT CONFIRMED that the axes stand still. Use the emergency stop. {why}',
    station: 'Station', operator: 'Your name', operator_missing: 'First type your name.',

    new_run: 'New run', serial: 'Serial number of the camera',
    serial_hint: 'Scan the label or type it. The calibration with this number is used, and must be the connected camera\u2019s own.',
    start: 'Start', run_from: '{poses} poses with {marker}', unfinished: 'Runs that did not come to their end',
    unfinished_hint: 'What was measured is kept. Going on homes the stage and measures the rest.',
    go_on: 'Go on', camera: 'Camera', begun: 'Begun', ended_because: 'Why it ended',
    phase_preparing: 'Prepare', phase_measuring: 'Measure', phase_analysing: 'Analyse', phase_ended: 'Verdict',
    left: 'left', poses_done: '{visited} of {poses} poses', preparing: 'Devices are opened, the stage is homed',
    analysing: 'The poses are rendered and compared', pause: 'Pause',
    pause_hint: 'Pause ends the motion and lets the devices go; the run can be gone on with at any time.',
    pausing: 'Pausing \u2026', photograph: 'Photograph, pose {pose}', render: 'The same pose as the calibration says it looks',
    volume: 'The volume', volume_label: 'Poses of the plan, visited ones filled: {visited} of {poses}',
    legend: 'Ring: planned. Filled: seen. Cross: marker not seen. Orange: the latest.',
    first_figures: 'First figures', marker_seen_in: 'Marker seen', of_poses: 'of {visited} poses',
    corner_noise: 'Noise of a corner', frames_again: 'Frames taken again',
    means_PASS: 'The camera measures what its calibration promises.',
    means_FAIL: 'The camera does not measure what its calibration promises.',
    means_INCONCLUSIVE: 'This run cannot tell. It is not the camera\u2019s fault.',
    means_ERROR: 'The run broke off. What was measured is kept.',
    means_ABORTED: 'The run was stopped. What was measured is kept.',
    means_PAUSED: 'The stage stands still and the devices are free.', word_ABORTED: 'STOPPED', word_PAUSED: 'PAUSED',
    why: 'Why', most_probable: 'Most probable cause', percent: '{n} %', to_do: 'What to do', findings: 'What the photographs show',
    quantity: 'Quantity', value: 'Value', limit: 'Limit', outcome: 'Outcome', open_report: 'Open the report',
    another: 'New run', not_started: 'The run did not start',

    live: 'The camera\u2019s picture', live_start: 'Show', live_end: 'Hide', live_off: 'The picture is off. It takes the camera until it is hidden or a run starts.',
    live_alt: 'Live picture of the camera', live_wait: 'The camera is opened \u2026',
    marker_yes: 'Marker found (outlined)', marker_no: 'Marker not found: {why}',
    sharpness: 'Sharpness', saturated: 'Saturated', brightness: 'Mean', noise: 'Noise', per_second: 'Pictures', exposure: 'Exposure', gain: 'Gain',
    set: 'Set', live_settings_hint: 'For looking only: a run takes {exposure} \u00b5s and {gain} dB from the station\u2019s file.',
    bad_frames: 'Broken frames', stage: 'The stage', home: 'Home all axes',
    home_question: 'Homing moves every axis until it has found its zero, by the controller\u2019s own way: soft limits do not hold. Is the way clear?',
    step: 'Step', axis_minus: '{axis}: {step} {unit} back', axis_plus: '{axis}: {step} {unit} ahead',
    stage_unknown: 'The stage does not answer.', homed: 'homed', not_homed: 'not homed', moving: 'moves', enabled: 'enabled', off: 'off',
    alarm: 'ALARM {code}', emergency_stop: 'EMERGENCY STOP', at_limit: 'at a limit switch',
    plan: 'What the plan will do and see', plan_compute: 'Compute', plan_going: 'It is simulated: some ten seconds \u2026',
    plan_hint: 'Every pose is rendered and 20 runs are simulated, before anything moves.',
    plan_warnings: 'Look at this first', plan_no_warnings: 'Nothing to warn of.',
    warn_undetected: 'The marker is found in {n} of {poses} poses only.',
    warn_wide: '{name}: the uncertainty is {n} % of the limit. A good camera may come out as INCONCLUSIVE.',
    warn_blind: 'No run of this plan says anything of: {names}.',
    plan_does: '{poses} poses, {hold_out} of them to judge, about {time}', expected_u: 'Expected U', share: 'U of the limit',
    error: 'Error', detectable: 'Found from', devices: 'Devices', devices_find: 'Look for cameras',
    devices_hint: 'Each camera is opened for a moment.', devices_none: 'No camera was found.', address: 'Address', model: 'Model', fault: 'Fault',

    runs: 'Runs', who: 'Operator', all: 'all', date: 'Date (UTC)', no_runs: 'No runs yet.', report: 'Report', charts: 'Control charts',
    charts_hint: 'Choose a camera to see its charts.', drift: 'DRIFT', no_drift: 'no drift',
    chart_label: '{quantity} of camera {camera}, {n} runs', chart_legend: 'Line: value. Band: U. Dashes: the limit. Red: drift alarm.',
    cameras: 'Cameras', last_run: 'Last run', due: 'Due', state: 'State', due_now: 'due: it never passed', due_since: 'due since {day}',
    trend: 'TREND: {quantity} changes by {rate} {unit} a year ({n} runs)',
    fleet_legend: 'Due: so many days after the last PASS as the limits file says (due_after_days). Trend: since the latest calibration; a camera without one shows one with 1 % probability at each look.',
  },
  de: {
    stop: 'STOPP', stop_label: 'Alle Achsen anhalten und Laufendes beenden', views: 'Ansichten',
    view_setup: 'Einrichten', view_run: 'Messen', view_fleet: 'Kameras', language: 'Sprache',
    yes: 'Ja', no: 'Nein',
    lost: 'Die Verbindung zum Rechner der Station ist weg. Eine Messung kann weiterlaufen. Zum Anhalten den Not-Halt dr\u00fccken.',
    idle: 'Diese Seite bewegt nichts.', by_since: '{what} von {who} seit {time}',
    work_run: 'Messung', work_homing: 'Referenzfahrt', work_motion: 'Fahrt',
    stop_stopping: 'H\u00e4lt an \u2026', stop_confirmed: 'Angehalten: Die Steuerung best\u00e4tigt, dass keine Achse f\u00e4hrt.',
    stop_failed: 'NICHT BEST\u00c4TIGT, dass die Achsen stehen. Den Not-Halt dr\u00fccken. {why}',
    station: 'Station', operator: 'Ihr Name', operator_missing: 'Zuerst den Namen eingeben.',

    new_run: 'Neue Messung', serial: 'Seriennummer der Kamera',
    serial_hint: 'Etikett scannen oder eintippen. Die Kalibrierung mit dieser Nummer wird verwendet; sie muss die der angeschlossenen Kamera sein.',
    start: 'Starten', run_from: '{poses} Posen mit {marker}', unfinished: 'Messungen, die nicht zu Ende kamen',
    unfinished_hint: 'Was gemessen wurde, bleibt. Beim Fortsetzen macht der Tisch eine Referenzfahrt und misst den Rest.',
    go_on: 'Fortsetzen', camera: 'Kamera', begun: 'Begonnen', ended_because: 'Warum sie endete',
    phase_preparing: 'Vorbereiten', phase_measuring: 'Messen', phase_analysing: 'Auswerten', phase_ended: 'Urteil',
    left: '\u00fcbrig', poses_done: '{visited} von {poses} Posen', preparing: 'Ger\u00e4te werden ge\u00f6ffnet, der Tisch macht eine Referenzfahrt',
    analysing: 'Die Posen werden gerendert und verglichen', pause: 'Pause',
    pause_hint: 'Pause beendet die Fahrt und gibt die Ger\u00e4te frei; die Messung kann jederzeit fortgesetzt werden.',
    pausing: 'Pausiert gleich \u2026', photograph: 'Foto, Pose {pose}', render: 'Dieselbe Pose, wie sie nach der Kalibrierung aussieht',
    volume: 'Das Volumen', volume_label: 'Posen des Plans, besuchte gef\u00fcllt: {visited} von {poses}',
    legend: 'Ring: geplant. Gef\u00fcllt: gesehen. Kreuz: Marker nicht gesehen. Orange: die letzte.',
    first_figures: 'Erste Zahlen', marker_seen_in: 'Marker gesehen', of_poses: 'von {visited} Posen',
    corner_noise: 'Rauschen einer Ecke', frames_again: 'Bilder wiederholt',
    means_PASS: 'Die Kamera misst, was ihre Kalibrierung verspricht.',
    means_FAIL: 'Die Kamera misst nicht, was ihre Kalibrierung verspricht.',
    means_INCONCLUSIVE: 'Diese Messung kann es nicht entscheiden. Das liegt nicht an der Kamera.',
    means_ERROR: 'Die Messung brach ab. Was gemessen wurde, bleibt.',
    means_ABORTED: 'Die Messung wurde angehalten. Was gemessen wurde, bleibt.',
    means_PAUSED: 'Der Tisch steht, die Ger\u00e4te sind frei.', word_ABORTED: 'ANGEHALTEN', word_PAUSED: 'PAUSE',
    why: 'Warum', most_probable: 'Wahrscheinlichste Ursache', percent: '{n} %', to_do: 'Was zu tun ist', findings: 'Was die Fotos zeigen',
    quantity: 'Gr\u00f6\u00dfe', value: 'Wert', limit: 'Grenze', outcome: 'Urteil', open_report: 'Bericht \u00f6ffnen',
    another: 'Neue Messung', not_started: 'Die Messung hat nicht begonnen',

    live: 'Bild der Kamera', live_start: 'Zeigen', live_end: 'Ausblenden', live_off: 'Das Bild ist aus. Es belegt die Kamera, bis es ausgeblendet wird oder eine Messung beginnt.',
    live_alt: 'Livebild der Kamera', live_wait: 'Die Kamera wird ge\u00f6ffnet \u2026',
    marker_yes: 'Marker gefunden (umrandet)', marker_no: 'Marker nicht gefunden: {why}',
    sharpness: 'Sch\u00e4rfe', saturated: '\u00dcberbelichtet', brightness: 'Mittel', noise: 'Rauschen', per_second: 'Bilder', exposure: 'Belichtung', gain: 'Verst\u00e4rkung',
    set: 'Einstellen', live_settings_hint: 'Nur zum Ansehen: Eine Messung nimmt {exposure} \u00b5s und {gain} dB aus der Datei der Station.',
    bad_frames: 'Defekte Bilder', stage: 'Der Tisch', home: 'Referenzfahrt aller Achsen',
    home_question: 'Bei der Referenzfahrt f\u00e4hrt jede Achse auf eigenem Weg, bis sie ihren Nullpunkt hat: Software-Grenzen gelten nicht. Ist der Weg frei?',
    step: 'Schritt', axis_minus: '{axis}: {step} {unit} zur\u00fcck', axis_plus: '{axis}: {step} {unit} vor',
    stage_unknown: 'Der Tisch antwortet nicht.', homed: 'referenziert', not_homed: 'nicht referenziert', moving: 'f\u00e4hrt', enabled: 'freigegeben', off: 'aus',
    alarm: 'ALARM {code}', emergency_stop: 'NOT-HALT', at_limit: 'am Endschalter',
    plan: 'Was der Plan tun und sehen wird', plan_compute: 'Berechnen', plan_going: 'Wird simuliert: etwa zehn Sekunden \u2026',
    plan_hint: 'Jede Pose wird gerendert und 20 Messungen werden simuliert, bevor sich etwas bewegt.',
    plan_warnings: 'Das zuerst ansehen', plan_no_warnings: 'Keine Warnungen.',
    warn_undetected: 'Der Marker wird nur in {n} von {poses} Posen gefunden.',
    warn_wide: '{name}: Die Unsicherheit ist {n} % der Grenze. Auch eine gute Kamera kann INCONCLUSIVE ergeben.',
    warn_blind: 'Keine Messung dieses Plans sagt etwas \u00fcber: {names}.',
    plan_does: '{poses} Posen, davon {hold_out} zum Beurteilen, etwa {time}', expected_u: 'Erwartetes U', share: 'U an der Grenze',
    error: 'Fehler', detectable: 'Gefunden ab', devices: 'Ger\u00e4te', devices_find: 'Kameras suchen',
    devices_hint: 'Jede Kamera wird kurz ge\u00f6ffnet.', devices_none: 'Keine Kamera gefunden.', address: 'Adresse', model: 'Modell', fault: 'St\u00f6rung',

    runs: 'Messungen', who: 'Bediener', all: 'alle', date: 'Datum (UTC)', no_runs: 'Noch keine Messungen.', report: 'Bericht', charts: 'Regelkarten',
    charts_hint: 'Eine Kamera w\u00e4hlen, um ihre Karten zu sehen.', drift: 'DRIFT', no_drift: 'keine Drift',
    chart_label: '{quantity} der Kamera {camera}, {n} Messungen', chart_legend: 'Linie: Wert. Band: U. Gestrichelt: die Grenze. Rot: Drift-Alarm.',
    cameras: 'Kameras', last_run: 'Letzte Messung', due: 'F\u00e4llig', state: 'Zustand', due_now: 'f\u00e4llig: sie hat nie bestanden', due_since: 'f\u00e4llig seit {day}',
    trend: 'TREND: {quantity} \u00e4ndert sich um {rate} {unit} im Jahr ({n} Messungen)',
    fleet_legend: 'F\u00e4llig: so viele Tage nach dem letzten PASS, wie die Grenzwertdatei sagt (due_after_days). Trend: seit der neuesten Kalibrierung; eine Kamera ohne Trend zeigt bei jedem Blick mit 1 % Wahrscheinlichkeit einen.',
  },
};

// The browser may keep nothing: then the choice lasts as long as the page.
export const kept = {
  get: name => { try { return localStorage.getItem(name); } catch { return null; } },
  set: (name, value) => { try { localStorage.setItem(name, value); } catch { /* as said */ } },
};

const known = name => Object.hasOwn(strings, name) ? name : null;

let chosen = known(kept.get('language')) ?? (navigator.language.startsWith('de') ? 'de' : 'en');

export function language() { return chosen; }

export function speak(name) {
  chosen = known(name) ?? 'en';
  kept.set('language', chosen);
}

// The text with its {places} filled.
export function text(key, places = {}) {
  const found = strings[chosen][key];
  if (found === undefined) throw new Error(`there is no text ${key}`);
  return found.replace(/\{(\w+)\}/g, (_, name) => String(places[name]));
}

// "14:05" of "2026-03-07T14:05:09Z", where the reader is.
export function clock(utc) {
  return utc ? new Date(utc).toLocaleTimeString(chosen, {hour: '2-digit', minute: '2-digit', hour12: false}) : '';
}

// "42 s", "3:07 min", "1:02 h"
export function duration(seconds) {
  const s = Math.round(seconds), two = n => String(n).padStart(2, '0');
  if (s < 60) return `${s} s`;
  if (s < 3600) return `${Math.floor(s / 60)}:${two(s % 60)} min`;
  return `${Math.floor(s / 3600)}:${two(Math.floor(s % 3600 / 60))} h`;
}
