// SPDX-License-Identifier: Apache-2.0
#include "tests/support/graph_nodes.h"

#include "rayloom/core/registry.h"

#include <string>
#include <vector>

namespace rayloom::test
{

namespace
{

/// Hands its first input on; tests of the graph file never run a node.
template <class P>
class FileTestNode : public Node
{
public:
    using Params = P;
    explicit FileTestNode(const P&) {}
    void plan(PlanContext&) override { throw NodeError("a node for tests of the graph file"); }
    void compute(const TileContext&) const override {}
};

struct GainParams {
    float factor = 1.0f;
    int repeat = 1;
};
class Gain final : public FileTestNode<GainParams>
{
public:
    using FileTestNode::FileTestNode;
    static void describe(Declaration<GainParams>& d)
    {
        d.name("mock.gain").summary("Multiplies by a factor.");
        d.input("image", "what to multiply");
        d.output("image", "the product");
        d.param("factor", &GainParams::factor, "What to multiply by.").range(0.0, 16.0);
        d.param("repeat", &GainParams::repeat, "How often to do it.").range(1, 8);
    }
};

struct BlendParams {
    std::string mode = "over";
};
class Blend final : public FileTestNode<BlendParams>
{
public:
    using FileTestNode::FileTestNode;
    static void describe(Declaration<BlendParams>& d)
    {
        d.name("mock.blend").summary("Puts one image over another.");
        d.input("image", "the image below");
        d.input("guide", "the image above").optional();
        d.output("mean", "the blend");
        d.output("variance", "what was lost");
        d.param("mode", &BlendParams::mode, "How to blend.").choices({"over", "under", "add"});
    }
};

struct LevelsParams {
    int scales = 3;
};
class Levels final : public FileTestNode<LevelsParams>
{
public:
    using FileTestNode::FileTestNode;
    static void describe(Declaration<LevelsParams>& d)
    {
        d.name("mock.levels").summary("Makes a list of one image.");
        d.input("image", "the image");
        d.output("levels", "the list").list();
        d.param("scales", &LevelsParams::scales, "Length of the list.").range(1, 6);
    }
};

struct NoParams {
};
class Join final : public FileTestNode<NoParams>
{
public:
    using FileTestNode::FileTestNode;
    static void describe(Declaration<NoParams>& d)
    {
        d.name("mock.join").summary("Makes one image of a list.");
        d.input("levels", "the list").list();
        d.output("image", "the image");
    }
};

class Flatten final : public FileTestNode<NoParams>
{
public:
    using FileTestNode::FileTestNode;
    static void describe(Declaration<NoParams>& d)
    {
        d.name("mock.flatten").summary("Flattens a deep image.");
        d.input("deep", "the deep image").deep();
        d.output("image", "the flat one");
    }
};

class Measure final : public FileTestNode<NoParams>
{
public:
    using FileTestNode::FileTestNode;
    static void describe(Declaration<NoParams>& d)
    {
        d.name("mock.measure").summary("Measures an image.");
        d.input("image", "the image");
        d.output("figures", "what was measured").table();
    }
};

class Apply final : public FileTestNode<NoParams>
{
public:
    using FileTestNode::FileTestNode;
    static void describe(Declaration<NoParams>& d)
    {
        d.name("mock.apply").summary("Applies what was measured.");
        d.input("image", "the image");
        d.input("figures", "what was measured").table();
        d.output("image", "the corrected image");
    }
};

struct SaveParams {
    std::string path;
};
class Save final : public FileTestNode<SaveParams>
{
public:
    using FileTestNode::FileTestNode;
    static void describe(Declaration<SaveParams>& d)
    {
        d.name("mock.save").summary("Saves an image.");
        d.input("image", "the image");
        d.param("path", &SaveParams::path, "Where to.").required();
    }
};

struct FilesParams {
    std::string file;
    std::vector<std::string> files;
};
class Files final : public FileTestNode<FilesParams>
{
public:
    using FileTestNode::FileTestNode;
    static void describe(Declaration<FilesParams>& d)
    {
        d.name("mock.files").summary("Reads files.");
        d.output("image", "what is in them");
        d.param("file", &FilesParams::file, "One file.").path();
        d.param("files", &FilesParams::files, "Several files.").path();
    }
};

struct TypesParams {
    bool flag = false;
    int whole = 2;
    double real = 0.5;
    std::string text = "word";
    std::string choice = "soft";
    std::vector<double> reals{1.0, 2.0};
    std::vector<std::string> texts{"a", "b"};
};
class Types final : public FileTestNode<TypesParams>
{
public:
    using FileTestNode::FileTestNode;
    static void describe(Declaration<TypesParams>& d)
    {
        d.name("mock.types").summary("Has a parameter of every type.");
        d.input("image", "the image");
        d.output("image", "the same image");
        d.param("flag", &TypesParams::flag, "Yes or no.");
        d.param("whole", &TypesParams::whole, "A whole number.").range(-5, 5);
        d.param("real", &TypesParams::real, "A number.").min(0.0).unit("px");
        d.param("text", &TypesParams::text, "Any text.");
        d.param("choice", &TypesParams::choice, "One of a few.").choices({"soft", "hard"});
        d.param("reals", &TypesParams::reals, "Numbers.").range(0.0, 10.0);
        d.param("texts", &TypesParams::texts, "Texts.");
    }
};

} // namespace

void register_graph_nodes()
{
    [[maybe_unused]] static const bool once = [] {
        Registry& registry = Registry::instance();
        registry.add(node_info<Gain>());
        registry.add(node_info<Blend>());
        registry.add(node_info<Levels>());
        registry.add(node_info<Join>());
        registry.add(node_info<Flatten>());
        registry.add(node_info<Measure>());
        registry.add(node_info<Apply>());
        registry.add(node_info<Save>());
        registry.add(node_info<Files>());
        registry.add(node_info<Types>());
        return true;
    }();
}

} // namespace rayloom::test
