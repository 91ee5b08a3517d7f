// A small stand-in, for tests alone: a plugin is made by make<Base>().
#pragma once
#include <memory>
template <class Base> std::unique_ptr<Base> make();
#define PLUGINLIB_EXPORT_CLASS(Class, Base) \
    template <> std::unique_ptr<Base> make<Base>() { return std::make_unique<Class>(); }
