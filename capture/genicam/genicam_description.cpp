#include <fmt/format.h>
#include <libxml/parser.h>
#include <libxml/tree.h>

#include <cctype>
#include <cerrno>
#include <cstdlib>
#include <set>

#include "capture/genicam/genicam_device.h"

namespace etalon {
namespace {

constexpr int max_links_of_a_value = 64;            // real cameras have some 20
constexpr double max_evaluations = 1e5;             // of a value
constexpr long long max_register_length = 1 << 30;  // of a register, in bytes

// What a node's value is made from; limits, selectors and states may lead back to it.
const std::set<std::string_view> value_reference_tags = {
    "pValue",  "pVariable",     "pAddress",      "pIndex",
    "pLength", "pValueIndexed", "pValueDefault", "pCommandValue"};

std::string_view name_of(const xmlNode* node) {
    return reinterpret_cast<const char*>(node->name);
}

// Without spaces, at which the library may cut.
std::string word(const xmlChar* text) {
    std::string found;
    for (; text && *text; ++text)
        if (!std::isspace(*text))
            found += static_cast<char>(*text);
    return found;
}

std::string attribute(xmlNode* node, const char* name) {
    xmlChar* value = xmlGetProp(node, reinterpret_cast<const xmlChar*>(name));
    const std::string found = word(value);
    xmlFree(value);
    return found;
}

// The library reads plain text alone.
std::string text_of(const xmlNode* node) {
    std::string found;
    for (const xmlNode* child = node->children; child; child = child->next)
        if (child->type == XML_TEXT_NODE)
            found += word(child->content);
    return found;
}

template <typename Visit>
void each_element(xmlNode* node, const Visit& visit) {
    for (xmlNode* child = node->children; child; child = child->next)
        if (child->type == XML_ELEMENT_NODE) {
            visit(child);
            each_element(child, visit);
        }
}

struct Node {
    long line;
    std::vector<std::string> references;
    int links = -1;  // the longest way to a value that needs no other; -1: not yet known
    double evaluations = 1.0;
};

class Description {
public:
    explicit Description(xmlNode* root) {
        each_element(root, [&](xmlNode* element) {
            if (const std::string name = attribute(element, "Name");
                !name.empty() && !value_reference_tags.contains(name_of(element)))
                add(name, element);
            if (name_of(element) == "Length")
                require_possible_length(element);
        });
    }

    void require_ends() {
        for (auto& [name, node] : nodes_)
            follow(name, node, 0);
    }

private:
    void add(const std::string& name, xmlNode* element) {
        Node& node = nodes_.try_emplace(name, Node{xmlGetLineNo(element), {}}).first->second;
        const auto collect = [&](xmlNode* property) {
            if (value_reference_tags.contains(name_of(property)))
                node.references.push_back(text_of(property));
            if (const std::string offset = attribute(property, "pOffset"); !offset.empty())
                node.references.push_back(offset);
        };
        each_element(name_of(element) == "StructEntry" ? element->parent : element, collect);
    }

    static void require_possible_length(const xmlNode* element) {
        errno = 0;
        const std::string text = text_of(element);
        const long long length = std::strtoll(text.c_str(), nullptr, 0);
        if (errno != 0 || length < 0 || length > max_register_length)
            throw Error(fmt::format("line {}: a register of {} bytes", xmlGetLineNo(element),
                                    text.substr(0, 40)));
    }

    void follow(const std::string& name, Node& node, int links_before) {
        if (node.links >= 0 && links_before + node.links <= max_links_of_a_value)
            return;
        if (links_before > max_links_of_a_value)
            throw Error(
                fmt::format("line {}: '{}' refers to itself, or to more than {} values one "
                            "after another",
                            node.line, name, max_links_of_a_value));
        int links = 0;
        double evaluations = 1.0;
        for (const std::string& reference : node.references)
            if (const auto other = nodes_.find(reference); other != nodes_.end()) {
                follow(other->first, other->second, links_before + 1);
                links = std::max(links, other->second.links + 1);
                evaluations += other->second.evaluations;
            }
        if (evaluations > max_evaluations)
            throw Error(fmt::format("line {}: '{}' takes more than {:.0f} other values", node.line,
                                    name, max_evaluations));
        node.links = links;
        node.evaluations = evaluations;
    }

    std::map<std::string, Node> nodes_;
};

}  // namespace

void require_sound_description(const std::string& xml) {
    const int options = XML_PARSE_NONET | XML_PARSE_NOERROR | XML_PARSE_NOWARNING;
    const std::unique_ptr<xmlDoc, decltype(&xmlFreeDoc)> document(
        xmlReadMemory(xml.data(), static_cast<int>(xml.size()), nullptr, nullptr, options),
        &xmlFreeDoc);
    if (!document) {
        const auto* error = xmlGetLastError();
        throw Error(fmt::format("line {}: not well-formed XML", error ? error->line : 1));
    }
    Description description(xmlDocGetRootElement(document.get()));
    description.require_ends();
}

}  // namespace etalon
