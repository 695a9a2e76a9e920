#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The Kubernetes manifests of server/deploy/kubernetes: kubernetes_test.py KDRAYD FOLDER

Every object is checked against the models that python3-kubernetes generates from the schema of the
API: unknown fields, wrong types, missing fields. What kustomize makes of them is checked against
the schema itself, by kubernetes-models, which npm installs into FOLDER. Then what the schema cannot
say: privileges, probes, labels that must match, options that kdrayd has. Exits with 77 (skipped)
without python3-kubernetes.
"""
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
DEPLOY = ROOT / "server/deploy"
KDRAYD = sys.argv[1] if len(sys.argv) > 1 else None
FOLDER = sys.argv[2] if len(sys.argv) > 2 else None
PACKAGES = {"kubernetes-models": "5.1.0"}
# Reads a JSON list of objects; prints a line for each that breaks the schema.
VALIDATE = """
import { readFileSync } from "node:fs";
for (const object of JSON.parse(readFileSync(0, "utf8"))) {
  const path = `kubernetes-models/${object.apiVersion}/${object.kind}`;
  try {
    new (await import(path))[object.kind](object).validate();
  } catch (error) {
    console.log(`${object.kind} ${object.metadata.name}: ${error.message}`);
  }
}
"""
MODELS = {
    ("v1", "ConfigMap"): "V1ConfigMap",
    ("v1", "Secret"): "V1Secret",
    ("v1", "Service"): "V1Service",
    ("apps/v1", "Deployment"): "V1Deployment",
    ("apps/v1", "StatefulSet"): "V1StatefulSet",
    ("policy/v1", "PodDisruptionBudget"): "V1PodDisruptionBudget",
    ("networking.k8s.io/v1", "NetworkPolicy"): "V1NetworkPolicy",
}
PLAIN = {"str": str, "int": int, "bool": bool, "float": (int, float), "datetime": str}


def checked(value, kind, place, faults):
    """The value as an object of the API's model `kind`; faults are appended, with their place."""
    found = re.fullmatch(r"list\[(.*)\]|dict\(str, (.*)\)", kind)
    if found and found[1]:
        if not isinstance(value, list):
            faults.append(f"{place} is not a list")
            return value
        return [checked(item, found[1], f"{place}[{i}]", faults) for i, item in enumerate(value)]
    if found:
        if not isinstance(value, dict):
            faults.append(f"{place} is not a map")
            return value
        return {key: checked(item, found[2], f"{place}.{key}", faults)
                for key, item in value.items()}
    if kind == "object":  # a number or a name, such as the port of a probe
        if not isinstance(value, (int, str)):
            faults.append(f"{place} is neither a number nor a name")
        return value
    if kind in PLAIN:
        if not isinstance(value, PLAIN[kind]) or (kind != "bool" and isinstance(value, bool)):
            faults.append(f"{place} is {value!r}, not of type {kind}")
        return value
    return checked_model(value, kind, place, faults)


def checked_model(value, kind, place, faults):
    model = getattr(kubernetes.client, kind)
    if not isinstance(value, dict):
        faults.append(f"{place} is not a map")
        return None
    names = {wire: name for name, wire in model.attribute_map.items()}
    faults += [f"{place}.{key} is unknown" for key in value if key not in names]
    parts = {names[key]: checked(item, model.openapi_types[names[key]], f"{place}.{key}", faults)
             for key, item in value.items() if key in names}
    try:
        return model(**parts)
    except ValueError as error:
        faults.append(f"{place}: {error}")
        return None


def faults_of(document):
    kind = MODELS.get((document.get("apiVersion"), document.get("kind")))
    if kind is None:
        return [f"{document.get('apiVersion')} {document.get('kind')} is not in the table of kinds"]
    faults = []
    checked(document, kind, document["kind"], faults)
    return faults


def documents():
    return [document for path in sorted((DEPLOY / "kubernetes").glob("*.yaml"))
            for document in yaml.safe_load_all(path.read_text())]


def workloads():
    return [d for d in documents() if d["kind"] in ("Deployment", "StatefulSet")]


def of_kind(kind):
    return [document for document in documents() if document["kind"] == kind]


def variables(container):
    return {entry["name"]: entry.get("value") for entry in container.get("env", [])}


class SchemaTest(unittest.TestCase):
    def test_every_object_has_only_known_fields_of_the_right_types(self):
        self.assertEqual([fault for document in documents() for fault in faults_of(document)], [])
        self.assertEqual(
            sorted(document["kind"] for document in documents()),
            ["Deployment", "NetworkPolicy", "NetworkPolicy", "PodDisruptionBudget",
             "PodDisruptionBudget", "Service", "Service", "StatefulSet"])

    def test_the_check_finds_unknown_fields_wrong_types_and_missing_fields(self):
        def broken(change):
            document = of_kind("StatefulSet")[0]
            change(document["spec"], document["spec"]["template"]["spec"]["containers"][0])
            return faults_of(document)

        cases = {
            "is unknown": lambda _, c: c.update(readynessProbe={}),
            "not of type int": lambda s, _: s.update(replicas="3"),
            "not of type str": lambda _, c: c["env"].append({"name": "A", "value": 8080}),
            "not of type bool": lambda _, c: c["securityContext"].update(readOnlyRootFilesystem=1),
            "is not a list": lambda _, c: c.update(ports={"containerPort": 1}),
            "`selector`, must not be": lambda s, _: s.pop("selector"),
            "neither a number": lambda _, c: c["livenessProbe"]["httpGet"].update(port=[1]),
        }
        for expected, change in cases.items():
            faults = broken(change)
            self.assertEqual(len(faults), 1, expected)
            self.assertIn(expected, faults[0])


def kustomized(folder=DEPLOY, components=""):
    """The objects that kubectl makes, with these words in the list of components."""
    with tempfile.TemporaryDirectory() as copy:
        shutil.copytree(folder, copy, dirs_exist_ok=True)
        settings = Path(copy, "kustomization.yaml")
        text = settings.read_text()
        assert "\ncomponents: []\n" in text
        settings.write_text(text.replace("components: []", f"components: [{components}]"))
        done = subprocess.run(["kubectl", "kustomize", copy], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return list(yaml.safe_load_all(done.stdout))


@unittest.skipUnless(shutil.which("kubectl"), "kubectl is not installed")
class KustomizeTest(unittest.TestCase):
    def test_the_objects_and_haproxys_settings_are_joined(self):
        joined = kustomized()
        self.assertEqual([fault for document in joined for fault in faults_of(document)], [])
        self.assertEqual(len(joined), len(documents()) + 1)
        settings, = (d for d in joined if d["kind"] == "ConfigMap")
        proxy, = (d for d in joined if d["kind"] == "Deployment")
        self.assertEqual(set(settings["data"]), {"replicas.cfg", "servers.cfg"})
        self.assertEqual(proxy["spec"]["template"]["spec"]["volumes"][0]["configMap"]["name"],
                         settings["metadata"]["name"])

    def test_a_shared_store_adds_a_secret_and_a_policy(self):
        joined = kustomized(components="kubernetes/store")
        self.assertEqual([fault for document in joined for fault in faults_of(document)], [])
        self.assertEqual(len(joined), len(documents()) + 3)
        secret, = (d for d in joined if d["kind"] == "Secret")
        replicas, = (d for d in joined if d["kind"] == "StatefulSet")
        container, = replicas["spec"]["template"]["spec"]["containers"]
        self.assertEqual(container["envFrom"], [{"secretRef": {"name": secret["metadata"]["name"]}}])
        self.assertRegex(secret["metadata"]["name"], r"^kdray-store-\w+$")
        self.assertIn("KDRAY_STORE", secret["data"])
        policy, = (d["spec"] for d in joined if d["metadata"]["name"] == "kdray-store")
        self.assertEqual(policy["podSelector"], replicas["spec"]["selector"])

    @unittest.skipUnless(FOLDER and shutil.which("npm") and shutil.which("node"),
                         "npm is not installed")
    def test_the_schema_of_the_api_accepts_every_object(self):
        os.makedirs(FOLDER, exist_ok=True)
        manifest = json.dumps({"private": True, "dependencies": PACKAGES})
        mark = Path(FOLDER, "installed.json")
        if not mark.exists() or mark.read_text() != manifest:
            Path(FOLDER, "package.json").write_text(manifest)
            ended = subprocess.run(
                ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts",
                 "--no-package-lock", "--fetch-retries", "0"], cwd=FOLDER, capture_output=True)
            if ended.returncode:
                self.skipTest("npm could not install kubernetes-models")
            mark.write_text(manifest)
        Path(FOLDER, "validate.mjs").write_text(VALIDATE)

        def faults(objects):
            return subprocess.run(
                ["node", "validate.mjs"], cwd=FOLDER, input=json.dumps(objects), text=True,
                capture_output=True, check=True).stdout
        joined = kustomized(components="kubernetes/store")
        self.assertEqual(faults(joined), "")
        broken, = (d for d in joined if d["kind"] == "StatefulSet")
        broken["spec"]["replicas"] = "3"
        del broken["spec"]["selector"]
        self.assertRegex(faults([broken]), "selector.*replicas")


class RulesTest(unittest.TestCase):
    def test_no_container_has_privileges_or_writes_to_its_root(self):
        for workload in workloads():
            pod = workload["spec"]["template"]["spec"]
            self.assertTrue(pod["securityContext"]["runAsNonRoot"])
            self.assertGreater(pod["securityContext"]["runAsUser"], 0)
            self.assertEqual(pod["securityContext"]["seccompProfile"], {"type": "RuntimeDefault"})
            self.assertIs(pod["automountServiceAccountToken"], False)
            self.assertFalse({"hostNetwork", "hostPID", "hostIPC"} & set(pod))
            for container in pod["containers"]:
                context = container["securityContext"]
                self.assertEqual(context, {"allowPrivilegeEscalation": False,
                                           "readOnlyRootFilesystem": True,
                                           "capabilities": {"drop": ["ALL"]}})
                self.assertIn("memory", container["resources"]["limits"])
                for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
                    self.assertIn(probe, container)

    def test_selectors_ports_and_mounts_name_what_is_there(self):
        labels = [w["spec"]["template"]["metadata"]["labels"] for w in workloads()]
        for workload in workloads():
            self.assertEqual(workload["spec"]["selector"]["matchLabels"],
                             workload["spec"]["template"]["metadata"]["labels"])
            pod = workload["spec"]["template"]["spec"]
            volumes = {v["name"] for v in pod.get("volumes", [])} | {
                v["metadata"]["name"] for v in workload["spec"].get("volumeClaimTemplates", [])}
            for container in pod["containers"]:
                self.assertEqual({m["name"] for m in container["volumeMounts"]}, volumes)
                ports = {port["name"] for port in container["ports"]}
                for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
                    action = container[probe].get("httpGet") or container[probe]["tcpSocket"]
                    self.assertIn(action["port"], ports)
        for service in of_kind("Service"):
            self.assertIn(service["spec"]["selector"], labels)
        budgets = of_kind("PodDisruptionBudget")
        self.assertEqual(len(budgets), len(labels))
        for workload, own in zip(workloads(), labels):
            budget, = (b["spec"] for b in budgets if b["spec"]["selector"]["matchLabels"] == own)
            self.assertLess(budget["maxUnavailable"], workload["spec"]["replicas"])

    def test_prometheus_finds_a_port_with_metrics_in_every_pod(self):
        for workload in workloads():
            template = workload["spec"]["template"]
            notes = template["metadata"]["annotations"]
            container = template["spec"]["containers"][0]
            self.assertEqual((notes["prometheus.io/scrape"], notes["prometheus.io/path"]),
                             ("true", "/metrics"))
            self.assertIn(int(notes["prometheus.io/port"]),
                          [port["containerPort"] for port in container["ports"]])
        proxy = of_kind("Deployment")[0]["spec"]["template"]["spec"]["containers"][0]
        port, = (p["containerPort"] for p in proxy["ports"] if p["name"] == "metrics")
        self.assertEqual(variables(proxy)["KDRAY_METRICS_BIND"], f":{port}")

    def test_only_prometheus_reaches_the_metrics(self):
        allowed = {"namespaceSelector": {"matchLabels": {"kdray.metrics": "true"}}}
        policies = of_kind("NetworkPolicy")
        for workload in workloads():
            labels = workload["spec"]["template"]["metadata"]["labels"]
            policy, = (p["spec"] for p in policies if p["spec"]["podSelector"]["matchLabels"] == labels)
            container = workload["spec"]["template"]["spec"]["containers"][0]
            number = int(workload["spec"]["template"]["metadata"]["annotations"]["prometheus.io/port"])
            name, = (p["name"] for p in container["ports"] if p["containerPort"] == number)
            sources = [rule.get("from") for rule in policy["ingress"]
                       if name in [port["port"] for port in rule["ports"]]]
            self.assertEqual(len(sources), 1)
            self.assertIn(allowed, sources[0])

    def test_no_pod_sees_the_disks_or_names_of_its_machine(self):
        for workload in workloads():
            for volume in workload["spec"]["template"]["spec"].get("volumes", []):
                self.assertTrue({"configMap", "emptyDir"} & set(volume), volume["name"])

    def test_a_drain_ends_before_the_pod_is_killed(self):
        pod = of_kind("StatefulSet")[0]["spec"]["template"]["spec"]
        drain_ms = int(variables(pod["containers"][0])["KDRAY_DRAIN_TIMEOUT_MS"])
        self.assertGreater(pod["terminationGracePeriodSeconds"] * 1000, drain_ms + 5000)

    @unittest.skipUnless(KDRAYD, "no kdrayd was given")
    def test_every_setting_is_an_option_of_kdrayd(self):
        text = subprocess.run([KDRAYD, "--help"], capture_output=True, text=True, check=True).stdout
        container = of_kind("StatefulSet")[0]["spec"]["template"]["spec"]["containers"][0]
        self.assertLessEqual(set(variables(container)), set(re.findall(r"Env:(KDRAY_\w+)", text)))
        with tempfile.TemporaryDirectory() as folder:
            started = subprocess.Popen(
                [KDRAYD, "--host", "127.0.0.1", "--port", "0", "--data-dir", f"{folder}/store"],
                stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                env=dict(os.environ, **variables(container)))
            with started:
                self.assertIn("kdrayd listening on", started.stdout.readline())
                started.terminate()
            self.assertEqual(started.returncode, 0)

    def test_haproxy_knows_every_replica_and_accepts_its_files(self):
        replicas = of_kind("StatefulSet")[0]
        servers = (DEPLOY / "kubernetes/servers.cfg").read_text()
        name, service = replicas["metadata"]["name"], replicas["spec"]["serviceName"]
        self.assertEqual(
            re.findall(r"^ +server (\S+) (\S+?)\.\"", servers, re.MULTILINE),
            [(f"{name}-{i}", f"{name}-{i}.{service}") for i in range(replicas["spec"]["replicas"])])
        program = shutil.which("haproxy", path=os.environ.get("PATH", "") + ":/usr/sbin")
        if program is None:
            self.skipTest("haproxy is not installed")
        container = of_kind("Deployment")[0]["spec"]["template"]["spec"]["containers"][0]
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run(
                [program, "-c", "-f", DEPLOY / "haproxy/replicas.cfg", "-f",
                 DEPLOY / "kubernetes/servers.cfg"], capture_output=True, text=True,
                env={
                    **os.environ, **{n: v for n, v in variables(container).items() if v is not None},
                    "KDRAY_NAMESPACE": "default", "KDRAY_STATS": f"{folder}/socket"})
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_the_kustomization_names_every_file(self):
        text = yaml.safe_load((DEPLOY / "kustomization.yaml").read_text())
        self.assertEqual(sorted(text["resources"]), sorted(
            f"kubernetes/{path.name}" for path in (DEPLOY / "kubernetes").glob("*.yaml")))
        for generator in text["configMapGenerator"]:
            for path in generator["files"]:
                self.assertTrue((DEPLOY / path).is_file(), path)

    def test_the_shared_store_has_known_settings_and_ports(self):
        folder = DEPLOY / "kubernetes/store"
        names = set(re.findall(r"^#?([A-Z_]+)=", (folder / "store.env").read_text(), re.MULTILINE))
        documented = (ROOT / "docs/replicas.md").read_text()
        for name in names - {"KDRAY_STORE"}:
            self.assertIn(f"`{name}`", documented)
        if KDRAYD:
            text = subprocess.run([KDRAYD, "--help"], capture_output=True, text=True).stdout
            self.assertIn("Env:KDRAY_STORE", text)
        policy = yaml.safe_load((folder / "policy.yaml").read_text())
        self.assertEqual(faults_of(policy), [])
        self.assertEqual(policy["spec"]["policyTypes"], ["Egress"])
        self.assertEqual({port["port"] for rule in policy["spec"]["egress"]
                          for port in rule["ports"]}, {53, 443})
        # The daemons' own policy lets nothing out, so only this one does.
        own, = (d["spec"] for d in of_kind("NetworkPolicy") if d["metadata"]["name"] == "kdray")
        self.assertEqual(own["egress"], [])
        self.assertEqual(own["podSelector"], policy["spec"]["podSelector"])


if __name__ == "__main__":
    try:
        import kubernetes.client
    except ImportError:
        print("python3-kubernetes is not installed; the manifests are not checked")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1], verbosity=2)
