// SPDX-License-Identifier: BSD-3-Clause
//
// Empty elements are 0, missing ranges are those of 64 bits, missing limits and parts of the pose are left
// out: all of that is found in files.
#include "e57_xml.h"

#include <tinyxml2.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "numbers.h"

namespace hokuyo_sick_drivers {
namespace {

using Element = tinyxml2::XMLElement;

const Element* child(const Element* parent, const char* name) {
  return parent ? parent->FirstChildElement(name) : nullptr;
}

std::string textOf(const Element* element) {
  const char* text = element ? element->GetText() : nullptr;
  return text ? text : "";
}

[[noreturn]] void failAt(const Element& element, const std::string& what) {
  throw std::runtime_error("has an XML part whose element " + std::string(element.Name()) + ' ' + what);
}

template <class Number>
Number attribute(const Element& element, const char* name, Number fallback) {
  const char* text = element.Attribute(name);
  if (!text) return fallback;
  Number value;
  if (!parseWhole(text, value))
    failAt(element, "has " + std::string(name) + "=\"" + text + "\", expected a number");
  return value;
}

std::uint64_t count(const Element& element, const char* name) {
  const auto value = attribute<std::int64_t>(element, name, 0);
  if (value < 0) failAt(element, "has a negative " + std::string(name));
  return static_cast<std::uint64_t>(value);
}

// Of a Float, Integer or ScaledInteger; nothing if there is none.
std::optional<double> numberIn(const Element* parent, const char* name) {
  const Element* element = child(parent, name);
  if (!element) return {};
  const std::string text = textOf(element);
  double value = 0.0;
  if (text.find_first_not_of(" \t\r\n") != text.npos && !parseWhole(text, value)) {
    failAt(*element, "is \"" + text.substr(0, 40) + "\", expected a number");
  }
  const char* type = element->Attribute("type");
  if (type && std::string(type) == "ScaledInteger") {
    value = value * attribute(*element, "scale", 1.0) + attribute(*element, "offset", 0.0);
  }
  return value;
}

// Nothing if one of them is missing or they enclose nothing.
std::optional<Limits> limitsIn(const Element* parent, const std::string& name) {
  const auto min = numberIn(parent, (name + "Minimum").c_str()),
             max = numberIn(parent, (name + "Maximum").c_str());
  if (!min || !max || !(*min <= *max) || !std::isfinite(*max - *min)) return {};
  return Limits{*min, *max};
}

std::optional<Limits> wideLimitsIn(const Element* parent, const std::string& name) {
  const auto limits = limitsIn(parent, name);
  return limits && limits->max > limits->min ? limits : std::nullopt;
}

E57Field parseField(const Element& element) {
  using Type = E57Field::Type;
  E57Field field;
  field.name = element.Name();
  const char* type = element.Attribute("type");
  const std::string type_name = type ? type : "";
  if (type_name == "Float") {
    const char* precision = element.Attribute("precision");
    field.type = precision && std::string(precision) == "single" ? Type::kFloat : Type::kDouble;
  } else if (type_name == "Integer" || type_name == "ScaledInteger") {
    field.type = type_name == "Integer" ? Type::kInteger : Type::kScaledInteger;
    field.minimum = attribute(element, "minimum", field.minimum);
    field.maximum = attribute(element, "maximum", field.maximum);
    if (field.minimum > field.maximum) failAt(element, "has a minimum above its maximum");
    if (field.type == Type::kScaledInteger) {
      field.scale = attribute(element, "scale", 1.0);
      field.offset = attribute(element, "offset", 0.0);
    }
  } else if (type_name == "String") {
    field.type = Type::kString;
  } else {
    failAt(element, "is of type \"" + type_name + "\", expected Float, Integer, ScaledInteger or String");
  }
  if (type_name != "String" && element.Attribute("minimum") && element.Attribute("maximum")) {
    const double a = attribute(element, "minimum", 0.0) * field.scale + field.offset;
    const double b = attribute(element, "maximum", 0.0) * field.scale + field.offset;
    field.lowest = std::min(a, b);
    field.highest = std::max(a, b);
    field.bounded = std::isfinite(field.highest - field.lowest);
  }
  return field;
}

void parsePose(const Element* element, E57Scan& scan, std::vector<std::string>& warnings) {
  const auto component = [](const Element* of, const char* name) { return numberIn(of, name).value_or(0.0); };
  scan.has_pose = element != nullptr;
  if (const Element* t = child(element, "translation")) {
    const Eigen::Vector3d translation(component(t, "x"), component(t, "y"), component(t, "z"));
    if (translation.allFinite()) {
      scan.pose.translation() = translation;
    } else {
      warnings.push_back("the pose of " + scan.name + " has no finite translation; it is taken as 0");
    }
  }
  if (const Element* r = child(element, "rotation")) {
    const Eigen::Quaterniond q(component(r, "w"), component(r, "x"), component(r, "y"), component(r, "z"));
    const double norm = q.norm();
    if (norm > 1e-6 && norm < 1e6) {
      scan.pose.linear() = q.normalized().toRotationMatrix();
    } else {
      warnings.push_back("the pose of " + scan.name + " has no valid rotation; it is taken as none");
    }
  }
}

E57Scan parseScan(const Element& element, std::size_t number, std::vector<std::string>& warnings) {
  E57Scan scan;
  scan.name = textOf(child(&element, "name"));
  if (scan.name.empty()) scan.name = "scan " + std::to_string(number);
  parsePose(child(&element, "pose"), scan, warnings);
  const Element* bounds = child(&element, "indexBounds");
  scan.rows = limitsIn(bounds, "row");
  scan.columns = limitsIn(bounds, "column");
  scan.intensity = wideLimitsIn(child(&element, "intensityLimits"), "intensity");
  const Element* colour = child(&element, "colorLimits");
  scan.colour = {wideLimitsIn(colour, "colorRed"), wideLimitsIn(colour, "colorGreen"),
                 wideLimitsIn(colour, "colorBlue")};
  const Element* points = child(&element, "points");
  if (!points) return scan;
  scan.file_offset = count(*points, "fileOffset");
  scan.records = count(*points, "recordCount");
  const Element* prototype = child(points, "prototype");
  for (const Element* field = prototype ? prototype->FirstChildElement() : nullptr; field;
       field = field->NextSiblingElement()) {
    scan.fields.push_back(parseField(*field));
  }
  return scan;
}

// The XML with each namespace declared but once in its root element. Some programs declare one again, which
// XML forbids.
std::string withoutRepeatedNamespaces(const std::string& xml, std::vector<std::string>& warnings) {
  constexpr const char* kBlanks = " \t\r\n";
  const std::size_t root = xml.find("<e57Root");
  if (root == xml.npos) return xml;
  std::string result = xml.substr(0, root);
  std::map<std::string, std::string> declared;
  std::size_t begin = root;
  while (true) {
    // An attribute or the element's name, with the blanks before it.
    const std::size_t name = xml.find_first_not_of(kBlanks, begin);
    if (name == xml.npos) return xml;
    const std::size_t end_of_name = xml.find_first_of(" \t\r\n=>", name);
    const std::size_t equals = xml.find_first_not_of(kBlanks, end_of_name);
    std::size_t end = end_of_name;
    std::string value;
    if (equals != xml.npos && xml[equals] == '=') {
      const std::size_t quote = xml.find_first_of("\"'", equals);
      end = quote == xml.npos ? quote : xml.find(xml[quote], quote + 1);
      if (end == xml.npos) return xml;
      value = xml.substr(quote, ++end - quote);
    }
    if (end == xml.npos || end_of_name == name) return result + xml.substr(begin);  // the element's end
    const std::string attribute = xml.substr(name, end_of_name - name);
    const bool is_namespace = attribute.compare(0, 5, "xmlns") == 0;
    const auto [known, is_new] = declared.emplace(attribute, value);
    if (!is_namespace || is_new) {
      result += xml.substr(begin, end - begin);
    } else if (known->second == value) {
      warnings.push_back("the XML part declares " + attribute + " twice");
    } else {
      throw std::runtime_error("has an XML part that declares " + attribute + " twice, as " + known->second +
                               " and as " + value);
    }
    begin = end;
  }
}

}  // namespace

std::vector<E57Scan> parseE57Xml(const std::string& xml, std::vector<std::string>& warnings) {
  tinyxml2::XMLDocument document;
  const std::string text = withoutRepeatedNamespaces(xml, warnings);
  if (document.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS) {
    throw std::runtime_error(std::string("has an XML part that can't be parsed: ") + document.ErrorStr());
  }
  const Element* root = document.RootElement();
  if (!root || std::string(root->Name()) != "e57Root")
    throw std::runtime_error("has an XML part without e57Root");
  std::vector<E57Scan> scans;
  const Element* data3d = child(root, "data3D");
  for (const Element* scan = data3d ? data3d->FirstChildElement() : nullptr; scan;
       scan = scan->NextSiblingElement()) {
    scans.push_back(parseScan(*scan, scans.size() + 1, warnings));
  }
  return scans;
}

}  // namespace hokuyo_sick_drivers
