#include "models/equations/equation_source.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "models/equations/staged_equations.hpp"
#include "models/formulas/formula_text.hpp"

namespace orbid::models {

namespace {

using Node = ExpressionGraph::Node;
using Operation = ExpressionGraph::Operation;

/// More constants than these, and the flows of a model cannot be computed in packs any more.
constexpr std::size_t most_packed_constants = 48;
/// States of a fixed number of coordinates are inlined everywhere; beyond, loops are as fast.
constexpr std::size_t most_fixed_coordinates = 8;

/// "a, b, c" of what `text` gives for 0, 1, ...
template <class Text>
std::string listed(std::size_t count, const Text& text) {
    std::string list;
    for (std::size_t i = 0; i < count; ++i)
        list += (i > 0 ? ", " : "") + text(i);
    return list;
}

class SourceWriter {
public:
    SourceWriter(const Equations& equations, bool fixed)
        : equations_(equations),
          stages_(staged(equations, most_packed_constants, equations.surfaces().empty() || equations.dry_friction())),
          fixed_(fixed),
          n_(equations.coordinates().size()),
          q_(equations.parameters().size()) {
        // Constants there must be: what reads them has one at least.
        if (stages_.constants.empty()) stages_.constants.push_back(stages_.graph.variable(Operation::parameter, 0));
    }

    [[nodiscard]] std::string text() {
        std::string text =
            "// Written by orbid: equations of a job.\n"
            "#include \"models/formulas/formula_code.hpp\"\n"
            "#include \"models/kernels/model_kernel.hpp\"\n"
            "#include \"models/definition/parameter.cpp\"\n";
        if (!equations_.inputs().empty()) text += "#include \"models/definition/input_evaluation.cpp\"\n";
        text += "\nnamespace {\nusing namespace orbid::models;\n\nstruct Written {\n" + tables();
        text += fixed_ ? equations() : loop();
        text += "};\n\n}  // namespace\n\n";
        text += fmt::format(
            "extern \"C\" __attribute__((visibility(\"default\"))) const orbid::models::Kernel* {}() {{\n"
            "    static const {} kernel{};\n    return &kernel;\n}}\n",
            equation_entry, fixed_ ? "ModelKernel<Written>" : "DynamicKernel<Written>",
            fixed_ ? "" : fmt::format("({})", n_));
        return text;
    }

private:
    std::string tables() const {
        std::string text;
        for (const char* name : {"name", "summary", "equations"})
            text += fmt::format("    static constexpr std::string_view {} = \"equations\";\n", name);
        text += fmt::format("    static constexpr std::array parameters{{{}}};\n", listed(q_, [&](std::size_t i) {
                                return fmt::format("Parameter{{\"p{}\", \"1\", {}, 1.0, \"\"}}", i,
                                                   equations_.frequency() == i ? "positive" : "any_real");
                            }));
        if (!fixed_) {
            return text + fmt::format(
                              "    static constexpr Coordinate coordinate = real(\"x\", \"1\");\n"
                              "    static constexpr std::size_t smallest_size = {0}, default_size = {0};\n",
                              n_);
        }
        text += fmt::format("    static constexpr std::array coordinates{{{}}};\n", listed(n_, [&](std::size_t i) {
                                return fmt::format("{}(\"x{}\", \"1\")",
                                                   equations_.coordinates()[i].angle ? "angle" : "real", i);
                            }));
        if (equations_.frequency())
            text += fmt::format("    static constexpr std::size_t forcing_frequency = {};\n", *equations_.frequency());
        if (equations_.text().stiff) text += "    static constexpr bool stiff = true;\n";
        if (!equations_.inputs().empty())
            text += fmt::format("    static constexpr std::array inputs{{{}}};\n",
                                listed(equations_.inputs().size(),
                                       [](std::size_t i) { return fmt::format("real(\"u{}\", \"1\")", i); }));
        if (!equations_.surfaces().empty())
            text += fmt::format("    static bool smooth(const Values<double, {}>&) {{ return false; }}\n", q_);
        if (!equations_.surfaces().empty() && !equations_.dry_friction())
            text += fmt::format("    static constexpr std::size_t surface_count = {};\n", equations_.surfaces().size());
        return text;
    }

    [[nodiscard]] FormulaText statements(const std::vector<Node>& nodes) const {
        return {stages_.graph, nodes, equations_.dry_friction()};
    }
    /// The body of a function that returns all of these.
    [[nodiscard]] std::string body(const std::vector<Node>& nodes) const {
        const FormulaText formulas = statements(nodes);
        return fmt::format("{}        return {{{}}};\n    }}\n", formulas.definitions(), formulas.list());
    }

    std::string equations() const {
        const std::size_t c = stages_.constants.size();
        const std::string constants = fmt::format("const Values<T, {}>& c", c);
        const std::string state = fmt::format("const State<T, {}>& x", n_);
        std::string text =
            fmt::format("    template <class T>\n    static Values<T, {}> reduced(const Values<T, {}>& p) {{\n{}", c,
                        q_, body(stages_.constants));
        if (equations_.kind() == Kind::map)
            return text + function("map", fmt::format("{}, {}", state, constants), stages_.rates);
        std::string arguments = fmt::format("const T& phase, {}, {}", state, constants);
        const bool general = !equations_.surfaces().empty() && !equations_.dry_friction();
        if (general) {
            const std::size_t m = equations_.surfaces().size();
            text += fmt::format("    template <class T>\n    static Values<T, {}> surfaces({}) {{\n{}", m, arguments,
                                body(stages_.surfaces));
            arguments += fmt::format(", const std::array<double, {}>& side", m);
        }
        if (equations_.dry_friction()) arguments += ", const auto& side";
        if (!equations_.inputs().empty())
            arguments += fmt::format(", const std::array<T, {}>& u", equations_.inputs().size());
        if (!stages_.forcing) return text + function("rhs", arguments, stages_.rates);
        const FormulaText force = statements({*stages_.forcing});
        text += fmt::format(
            "    template <class T>\n    static T forcing(const T& phase, {}) {{\n{}        return {};\n    }}\n",
            constants, force.definitions(), force.result(0));
        text += function("rhs_forced", fmt::format("const T& force, {}, {}, const auto& side", state, constants),
                         stages_.rates);
        return text + fmt::format(
                          "    template <class T>\n    static State<T, {}> rhs({}) {{\n        return "
                          "rhs_forced<T>(forcing<T>(phase, c), x, c, {});\n    }}\n",
                          n_, arguments, equations_.dry_friction() ? "side" : "0.0");
    }

    [[nodiscard]] std::string function(const char* name, const std::string& arguments,
                                       const std::vector<Node>& nodes) const {
        return fmt::format("    template <class T>\n    static State<T, {}> {}({}) {{\n{}", n_, name, arguments,
                           body(nodes));
    }

    std::string loop() const {
        const FormulaText rates = statements(stages_.rates);
        std::string text = fmt::format(
            "    template <class T>\n    static void rhs(const T&, std::span<const T> x, const Values<T, {}>& p, "
            "std::span<T> f) {{\n        const auto c = constants(p);\n{}",
            q_, rates.definitions());
        for (std::size_t i = 0; i < n_; ++i)
            text += fmt::format("        f[{}] = {};\n", i, rates.result(i));
        return text + fmt::format(
                          "    }}\n    template <class T>\n    static Values<T, {}> constants(const Values<T, {}>& p) "
                          "{{\n{}",
                          stages_.constants.size(), q_, body(stages_.constants));
    }

    const Equations& equations_;
    StagedEquations stages_;
    bool fixed_;
    std::size_t n_, q_;
};

}  // namespace

std::optional<std::string> equation_source(const Equations& equations, std::string& why) {
    const bool fixed = equations.coordinates().size() <= most_fixed_coordinates;
    const bool angles = std::any_of(equations.coordinates().begin(), equations.coordinates().end(),
                                    [](const Coordinate& c) { return c.angle; });
    const bool plain = equations.kind() == Kind::autonomous && equations.surfaces().empty() && !angles &&
                       equations.inputs().empty() && !equations.text().stiff;
    if (!fixed && !plain) {
        why = fmt::format("more than {} coordinates, unless the equations are autonomous, smooth and without angles",
                          most_fixed_coordinates);
        return std::nullopt;
    }
    return SourceWriter(equations, fixed).text();
}

}  // namespace orbid::models
