#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "models/equations/equations.hpp"

namespace orbid::models {

/// Reads a model written as text: names, formulas, switching surfaces, claims about it, in this order. Use
/// Equations::read.
class EquationReader {
public:
    EquationReader(const EquationText& text, std::vector<EquationProblem>& problems);
    [[nodiscard]] std::shared_ptr<const Equations> read();

private:
    using Node = ExpressionGraph::Node;
    using Operation = ExpressionGraph::Operation;
    using Part = EquationProblem::Part;

    void report(Part part, std::size_t index, std::string rule, std::optional<std::size_t> position = {});
    void add_name(Part part, std::size_t index, const std::string& name, Node node);
    void read_names();
    void read_forcing();
    std::optional<Node> parsed(Part part, std::size_t index, const std::string& text);
    void read_formulas();
    void check_use();
    void check_numbers();
    void find_surfaces();
    void put_sides();
    void find_friction();
    void find_jumps();
    void check_symmetry();
    void make_tables();

    /// Depends on the state, the phase or an input.
    [[nodiscard]] bool moves(Node node) const;

    const EquationText& text_;
    std::vector<EquationProblem>& problems_;
    std::size_t problems_before_;
    std::shared_ptr<Equations> equations_;
    ExpressionGraph& graph_;
    std::vector<std::string> names_;
    std::vector<Node> nodes_;                    ///< of the names
    std::map<std::string, std::string> known_;   ///< name -> what it is
    std::vector<bool> used_;                     ///< of the names
    std::vector<std::optional<Node>> formulas_;  ///< of the coordinates
};

}  // namespace orbid::models
